/* One update of the predictive controller: measured momenta and horizon in, forces of the intervals out. Written by lgmpc.

   Sizes come first. Contacts and the wrench are those of the intervals, references those of the nodes, one more. World
   axes unless said otherwise. */
#ifndef LGMPC_MPC_H
#define LGMPC_MPC_H

enum { LGMPC_MPC_SOLVED, LGMPC_MPC_NOT_SOLVED, LGMPC_MPC_NOT_FINITE };

typedef struct {
  double time; /* s */
  double com[3]; /* measured centre of mass, m */
  double momentum[6]; /* measured, linear N.s, angular about the centre of mass N.m.s */
  double rotation[9]; /* of the base to the world, row by row */
  double inertia[9]; /* about the centre of mass, from the base's axes to the world's, kg.m2, row by row */
  double points[LGMPC_MPC_NODES][LGMPC_MPC_POINTS][3]; /* contact points, m; of a foot in the air, where it will touch down next */
  double normals[LGMPC_MPC_NODES][LGMPC_MPC_POINTS][3]; /* of the surfaces there, unit length */
  double flags[LGMPC_MPC_NODES][LGMPC_MPC_POINTS]; /* 1 for points that carry, else 0 */
  double friction[LGMPC_MPC_NODES][LGMPC_MPC_POINTS]; /* Coulomb coefficients to rely on */
  double wrench[LGMPC_MPC_NODES][6]; /* external force, N, and moment about the centre of mass, N.m */
  double com_reference[LGMPC_MPC_NODES + 1][3]; /* m */
  double com_velocity_reference[LGMPC_MPC_NODES + 1][3]; /* m/s */
  double angular_velocity_reference[LGMPC_MPC_NODES + 1][3]; /* of the base, rad/s */
  double attitude_reference[4]; /* of the base at the first node, quaternion x y z w */
  double catching; /* 1 while steps catch a push, else 0 */
  double legs_given; /* 1 if the next are used, else 0 */
  double legs[LGMPC_MPC_NODES + 1][3]; /* angular momentum of the legs' motion beside the base's, N.m.s */
} lgmpc_mpc_inputs;

typedef struct {
  double time; /* of the first node, s */
  double states[LGMPC_MPC_NODES + 1][9]; /* centre of mass, m; linear momentum, N.s; angular momentum, N.m.s */
  double forces[LGMPC_MPC_NODES][LGMPC_MPC_POINTS][3]; /* at the contact points, on the robot, N */
} lgmpc_mpc_plan;

typedef void lgmpc_mpc;

/* Memory of a controller; 0 if there is none. No other function allocates. */
lgmpc_mpc* lgmpc_mpc_create(void);
void lgmpc_mpc_destroy(lgmpc_mpc*);

/* Start the next update at rest instead of from the last plan. */
void lgmpc_mpc_reset_guess(lgmpc_mpc*);

/* Plan. Unless LGMPC_MPC_SOLVED is returned the plan is as it was: follow it further, for half its horizon at most. */
int lgmpc_mpc_update(lgmpc_mpc*, const lgmpc_mpc_inputs*, lgmpc_mpc_plan*);

#endif
