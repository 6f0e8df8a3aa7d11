/* The whole-body tick of {robot}: state and targets in, joint torques out. Written by lgmpc.

   Joints, in order: {joints}.
   Contact points, in order: {points}. */
#ifndef LGMPC_TICK_H
#define LGMPC_TICK_H

enum {{ LGMPC_NU = {nu}, LGMPC_TASKS = {tasks} }};
enum {{ LGMPC_SOLVED, LGMPC_NOT_SOLVED, LGMPC_NOT_FINITE }};

typedef struct {{
{inputs}
}} lgmpc_inputs;

typedef struct {{
  double torques[{nu}]; /* of the joints, N.m */
  double forces[{forces}]; /* at the contact points, world axes, on the robot, N */
  double acceleration[{nv}]; /* derivative of v */
}} lgmpc_outputs;

typedef struct lgmpc_tick lgmpc_tick;

/* Memory of a controller; 0 if there is none. No other function allocates. */
lgmpc_tick *lgmpc_tick_create(void);
void lgmpc_tick_destroy(lgmpc_tick *);

/* Discard the warm start. */
void lgmpc_tick_reset(lgmpc_tick *);

/* Solve a tick. Unless LGMPC_SOLVED is returned, the outputs are as they were: keep the torques and add damping. */
int lgmpc_tick_solve(lgmpc_tick *, const lgmpc_inputs *, lgmpc_outputs *);

#endif
