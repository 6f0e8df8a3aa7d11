"""The page: scene, controls, settings and plots on a viser server."""

import math
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from threading import RLock
from time import monotonic
from typing import Any

import numpy as np
import viser
from viser import uplot

from lgmpc.config.robots import build_robot
from lgmpc.lie import attitude, quaternion
from lgmpc.live.canvas import ROOT, LiveScene, rgb, wxyz
from lgmpc.live.controls import SettingControls, add_worlds
from lgmpc.live.history import PictureHistory
from lgmpc.live.pad import Axes, Pad
from lgmpc.live.wishes import Note, Order, OrderName, Pace, Pull, Restart, Save, Started, Tune
from lgmpc.locomotion.command import CommandEntry
from lgmpc.runs.log import MODES, RunLog
from lgmpc.runs.walking import heading
from lgmpc.typing import Array
from lgmpc.viz.body import load_body
from lgmpc.viz.marks import COLORS, Scale, turns_to
from lgmpc.viz.mesh import disc
from lgmpc.viz.overlay import Frames, add_overlay
from lgmpc.viz.scene import Material
from lgmpc.viz.stage import FLOOR_COLOR, add_solids, frame_camera
from lgmpc.world import Plane

_SWING = 30
"""Pictures over which the path of a swing is drawn."""
_PLOTTED, _PLOTTED_EVERY = 1800, 3
"""Pictures over which quantities are plotted, and the share of them."""
_FURTHER = 1.7
_FOLLOW_S, _JUMP_M = 0.2, 2.0
_TIME_AXIS = uplot.Scale(time=False, auto=True)
_STEPS = (0.1, 0.1, 0.2)
"""Of the velocities for a key that is not held, m/s and rad/s."""
_ORDERS: dict[str, OrderName] = {"stand": "arm", "lie": "lie", "damp": "disarm"}
"""Modes of a simulated robot, by their buttons."""
_LAYERS = {
    "forces": "contact forces", "planned": "planned forces", "cones": "friction cones", "com": "centre of mass",
    "horizon": "predicted path", "footholds": "next footholds", "swings": "swing paths", "command": "command",
    "push": "push", "belief": "believed ground",
}  # fmt: skip
"""Folders of the overlay and their labels."""


class Page:
    """The page of a run.

    Args:
        started: the first run; one of a robot at the end of a link has no pulls, no pace, and no other worlds.
        server: which serves it.
        pipe: to the loop.

    Attributes:
        robot: of the config.
        stale: whether to draw again although there is no new picture.
    """

    def __init__(self, started: Started, server: viser.ViserServer, pipe: Connection) -> None:
        config, self._deployed = started.config, started.deployed
        self.robot, self._config, self._server, self._pipe = build_robot(config), config, server, pipe
        robot = self.robot
        server.gui.set_panel_label(f"{config.name} · lgmpc live")
        self._scene = LiveScene(server)
        self._body = load_body(robot)
        lowest, highest = self._body.bounds(robot.q_reference)
        self._height = float(highest[2] - lowest[2])
        self._scale = Scale.of(self._height, robot.weight, robot.nf)
        self._half = self._body.trunk_half_sides()
        self._data = robot.create_data()
        self._shift, self._grip = np.zeros(3), np.zeros(3)
        self._gaits: tuple[str, ...] = ()
        self._held: Axes = (0.0, 0.0, 0.0)
        self._ended = ""
        self._told, self._plotted_at, self._followed_at, self.stale = 0.0, 0.0, 0.0, False
        self._pace, self._asking = Pace(), RLock()  # viser calls back in several threads
        self._layout(lowest, highest)
        server.on_client_disconnect(lambda _: None if server.get_clients() else self._halt())  # nobody sees it walk

    # Layout

    def _layout(self, lowest: Array, highest: Array) -> None:
        server, scene, gui = self._server, self._scene, self._server.gui
        camera = frame_camera(lowest, highest, np.zeros((1, 3)), np.zeros((0, 3)))
        target, eye = (np.array(camera[each])[[0, 2, 1]] * [1.0, -1.0, 1.0] for each in ("target", "position"))
        server.initial_camera.look_at = target
        server.initial_camera.position = target + _FURTHER * (eye - target)  # the panel covers a part of the picture
        server.initial_camera.fov = math.radians(float(camera["fov"]))  # type: ignore[arg-type]
        self._root = server.scene.add_frame(ROOT, show_axes=False)
        self._body.add_to(scene)
        self._body.animate(scene, np.zeros(1), self.robot.q_reference[None])  # until there is a picture
        for part in self._body.parts:
            path = f"/robot/{self.robot.model.names[part.joint]}/{part.name}"
            if not self._deployed:
                scene.node(path).on_drag(self._dragged(part.joint))
        self._status = gui.add_markdown("**starting**")
        stop = gui.add_button("Emergency stop: no torque", color="red", hint="space, or button B of a gamepad")
        stop.on_click(lambda _: self._order(Order("stop")))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Drive"):
            self._drive_tab()
        if not self._deployed:
            self._settings = tabs.add_tab("Settings")
        with tabs.add_tab("View"):
            self._view_tab()
        with tabs.add_tab("Plots"):
            self._plots = self._plots_tab()

    def _drive_tab(self) -> None:
        gui, limits = self._server.gui, self._config.locomotion.limits
        speed, turn = min(limits.speed_m_s, 1.5), min(limits.yaw_rate_rad_s, 2.5)
        self._sticks = {
            "vx": gui.add_slider("ahead, m/s", -speed, speed, 0.05, 0.0),
            "vy": gui.add_slider("left, m/s", -speed, speed, 0.05, 0.0),
            "turn": gui.add_slider("turn left, rad/s", -turn, turn, 0.05, 0.0),
        }
        pose = round(0.2 * self._height, 2)
        self._pose = {
            "height_m": gui.add_slider("height, m", -pose, pose, 0.005, 0.0),
            "pitch_rad": gui.add_slider("pitch, rad", -0.4, 0.4, 0.02, 0.0),
            "roll_rad": gui.add_slider("roll, rad", -0.4, 0.4, 0.02, 0.0),
        }
        for stick in self._sticks.values():
            stick.on_update(lambda _: self._steer())
        for slider in self._pose.values():
            slider.on_update(lambda _: self._command(**{name: float(each.value) for name, each in self._pose.items()}))
        still = gui.add_button("Stand still", hint="key X")
        still.on_click(lambda _: self._halt())
        self._pad = Pad(gui, self._hold, self._nudge, self._order)
        self._gait = gui.add_dropdown("gait", ("trot",))
        self._gait.on_update(lambda _: self._command(gait=self._gait.value))
        names = {str(name): name for name in _ORDERS.values()} if self._deployed else _ORDERS
        mode = gui.add_button_group("mode", tuple(names), hint="buttons A and X of a gamepad: the first and the second")
        mode.on_click(lambda _: self._order(Order(names[mode.value])))
        self._maneuver = gui.add_dropdown("manoeuvre", ("none",), visible=False)
        self._perform = gui.add_button("Perform", visible=False)
        self._perform.on_click(lambda _: self._command(maneuver=self._maneuver.value))
        self._on_key("x", "stand still", self._halt)
        with gui.add_folder("time"):
            self._scrub = gui.add_slider("look back, s", -30.0, 0.0, 0.05, 0.0, hint="at most 30 s; 0: now")
            self._scrub.on_update(lambda _: setattr(self, "stale", True))
            if not self._deployed:
                self._pace_controls()
        if not self._deployed:
            with gui.add_folder("again"):
                add_worlds(gui, self._height, self._restart)

    def _pace_controls(self) -> None:
        gui = self._server.gui
        self._paused = gui.add_checkbox("pause", False, hint="key P")
        self._paused.on_update(lambda _: self._set_pace())
        step = gui.add_button("Step", hint="one tick in a pause; key N")
        step.on_click(lambda _: self._step())
        self._speed = gui.add_slider("speed", 0.05, 1.0, 0.05, 1.0, hint="simulated over elapsed time")
        self._speed.on_update(lambda _: self._set_pace())
        save = gui.add_button("Save as a run")
        save.on_click(lambda _: self._ask(Save()))
        self._on_key("n", "one tick", self._step)
        self._on_key("p", "pause", lambda: setattr(self._paused, "value", not self._paused.value))

    def _view_tab(self) -> None:
        gui = self._server.gui
        self._follow = gui.add_checkbox("follow the robot", True)
        through = gui.add_checkbox("see through the robot", False)
        through.on_update(lambda _: self._set_opacity(0.35 if through.value else 1.0))
        for name, label in _LAYERS.items():
            box = gui.add_checkbox(label, name not in ("planned", "belief"))
            box.on_update(self._layer_switch(name, box))
        self._scene.hidden |= {"planned", "belief"}
        note = f"Arrows: {100.0 * self._scale.length:.2g} cm are {self._scale.newtons:g} N. "
        gui.add_markdown(note + ("" if self._deployed else "Drag a part of the robot to pull at it."))

    def _plots_tab(self) -> dict[str, Any]:
        gui, none = self._server.gui, np.zeros(2)
        names = {
            "velocity, m/s": ("ahead", "left", "commanded"), "height above the ground, m": ("height",),
            "tilt, degrees": ("tilt",),
            "largest torque, share of its limit": ("torque",),
        }  # fmt: skip
        colors = ("#0072B2", "#009E73", "#888888")
        return {
            title: gui.add_uplot(
                (none,) * (1 + len(lines)),
                (uplot.Series(label="s"), *map(_curve, lines, colors)),
                scales={"x": _TIME_AXIS}, title=title, aspect=1.6,
            )
            for title, lines in names.items()
        }  # fmt: skip

    # What the user does

    def _ask(self, wish: object) -> None:
        with self._asking, suppress(OSError):
            self._pipe.send(wish)

    def _command(self, **values: Any) -> None:
        self._ask(CommandEntry(at_s=0.0, **values))

    def _steer(self) -> None:
        """Command the velocities of the sliders and, on top, of what is held."""
        with self._asking:
            sliders = self._sticks.values()
            held = (share * slider.max for share, slider in zip(self._held, sliders, strict=True))
            vx, vy, turn = (
                max(each.min, min(each.max, round(each.value + more, 3)))
                for each, more in zip(sliders, held, strict=True)
            )
            self._command(velocity_m_s=(vx, vy, 0.0), yaw_rate_rad_s=turn, gait=self._gait.value)

    def _hold(self, axes: Axes) -> None:
        self._held = axes
        self._steer()

    def _nudge(self, direction: Axes) -> None:
        for slider, way, step in zip(self._sticks.values(), direction, _STEPS, strict=True):
            if way:
                slider.value = max(slider.min, min(slider.max, round(slider.value + way * step, 3)))

    def _halt(self) -> None:
        for stick in self._sticks.values():
            stick.value = 0.0
        self._steer()

    def _order(self, order: Order) -> None:
        self._ask(order)
        if order.name != "arm":
            self._halt()

    def _set_pace(self) -> None:
        self._pace = Pace(float(self._speed.value), bool(self._paused.value))
        self._ask(self._pace)

    def _step(self) -> None:
        self._ask(Pace(self._pace.speed, self._pace.paused, 1))

    def _restart(self, world: str) -> None:
        for slider in (*self._sticks.values(), *self._pose.values()):
            slider.value = 0.0
        self._ask(Restart(world))

    def _on_key(self, key: str, label: str, action: Callable[[], None]) -> None:
        async def triggered(_: Any) -> None:  # one after the other, unlike plain functions
            action()

        self._server.gui.add_command(label, hotkey=key.upper()).on_trigger(triggered)

    def _dragged(self, joint: int) -> Callable[[Any], Coroutine[Any, Any, None]]:
        """Return the reaction to a drag of a part of the robot: a pull from the grip to the pointer."""

        async def drag(event: Any) -> None:  # in order: the end comes last
            if event.phase == "end":
                self._ask(Pull(0))
                return
            node = self._scene.node(f"/robot/{self.robot.model.names[joint]}")
            w, x, y, z = node.wxyz
            if event.phase == "start":
                arm = np.array(event.start_position) - self._shift - node.position
                self._grip = quaternion.act(quaternion.inverse(np.array([x, y, z, w])), arm)
            target = np.array(event.end_position) - self._shift
            self._ask(Pull(joint, self._grip, target))

        return drag

    def _set_opacity(self, opacity: float) -> None:
        for part in self._body.parts:
            node = self._scene.node(f"/robot/{self.robot.model.names[part.joint]}/{part.name}")
            node.opacity = opacity

    def _layer_switch(self, name: str, box: Any) -> Callable[[Any], None]:
        """Return the reaction to a checkbox that shows or hides a folder of the overlay."""

        def switch(_: Any) -> None:
            self._scene.hidden = self._scene.hidden - {name} if box.value else self._scene.hidden | {name}

        return switch

    # What the run says

    def begin(self, started: Started, history: "PictureHistory") -> None:
        """Show another run."""
        scene, world = self._scene, history.world
        scene.remove("/ground")
        scene.remove("/overlay")
        floor = next((each for each in world.surfaces if isinstance(each, Plane)), Plane())
        turn = turns_to(np.array([floor.normal_vector]))[0]
        cell = self._scale.length
        self._server.scene.add_grid(
            f"{ROOT}/ground/floor", infinite_grid=True, cell_size=cell, section_size=5.0 * cell,
            fade_distance=40.0 * self._height, plane_color=rgb(FLOOR_COLOR), plane_opacity=1.0,
            cell_color=rgb(0xCBD3DC), section_color=rgb(0x9FABB8), shadow_opacity=0.2, wxyz=wxyz(turn),
            position=(0.0, 0.0, float(floor.height(np.zeros((1, 2)))[0])),
        )  # fmt: skip
        add_solids(scene, world, cell)
        self._gaits = started.gaits
        if started.tunable or self._deployed:
            self._gait.options = tuple(name for name in started.gaits if name != "stand") or started.gaits
            self._maneuver.options = started.maneuvers or ("none",)
            self._maneuver.visible = self._perform.visible = bool(started.maneuvers)
        if self._deployed:
            self._status.content = "**disarmed** · nothing is sent to the robot, and nothing shown of it, until *arm*"
        if started.tunable:
            self._values = SettingControls(self._server.gui, self._settings, started.config, started.tunable, self._ask)
        self._scrub.value = 0.0
        if not self._deployed:
            self._paused.value, self._speed.value = False, 1.0
        self._ended = ""

    def tuned(self, message: Tune) -> None:
        """Show the value of a setting as the controller has it."""
        self._values.confirm(message.key, message.value)

    def tell(self, message: Note) -> None:
        """Show a message."""
        if message.over:
            self._ended = f"\n\n**{'Failed' if message.error else 'Over'}: {message.text}**"
            self._told, self.stale = 0.0, True
        for client in self._server.get_clients().values():
            client.add_notification(
                "lgmpc live", message.text, color="red" if message.error else "green", auto_close_seconds=12.0
            )

    def watch(self) -> None:
        """Let go of what is held on a page that has fallen silent; called all the time."""
        self._pad.watch()

    def draw(self, history: "PictureHistory") -> None:
        """Draw the last picture, or the one that is looked back at."""
        if not self._server.get_clients():
            return
        self.stale, back = False, float(self._scrub.value)
        last = history.at(back)
        log, extras = history.log(last, _SWING), history.extras(last)
        now = monotonic()
        with self._server.atomic():
            self._draw(log, extras, history)
            if now - self._told > 0.25:
                self._told = now
                self._write_status(log, extras, back)
        if now - self._plotted_at > 0.5:
            self._plotted_at = now
            self._plot(history.log(last, _PLOTTED, _PLOTTED_EVERY))

    def _draw(self, log: RunLog, extras: Array, history: "PictureHistory") -> None:
        scene, frames = self._scene, Frames(np.zeros(1), np.array([log.ticks - 1]))
        self._body.animate(scene, frames.times, log.q[-1:])
        world = history.world
        add_overlay(scene, log, frames, self._scale, world, self._height, self._half)
        self._draw_belief(extras)
        scene.finish()
        if self._follow.value:
            x, y, _ = log.base_pose[-1, :3]
            target = -np.array([x, y, log.ground_height[-1]])
            way, now = target - self._shift, monotonic()
            share = 1.0 if np.linalg.norm(way) > _JUMP_M else 1.0 - math.exp((self._followed_at - now) / _FOLLOW_S)
            self._shift, self._followed_at = self._shift + share * way, now
            self._root.position = self._shift

    def _draw_belief(self, extras: Array) -> None:
        """Draw the ground that the controller believes in as a disc under the robot."""
        gx, gy = extras[3:5]
        normal = np.array([-gx, -gy, 1.0]) / math.sqrt(1.0 + gx * gx + gy * gy)
        self._scene.add_mesh(
            "/overlay/belief/plane", disc(1.5 * self._height), Material(COLORS["swings"], 0.35, flat=True)
        )
        turn = turns_to(normal[None])
        self._scene.animate(
            "/overlay/belief/plane", np.zeros(1), position=(extras[5:8] + 0.003 * normal)[None], quaternion=turn
        )

    def _write_status(self, log: RunLog, extras: Array, back: float) -> None:
        ahead, left = np.round(_velocity(log)[-1], 2)
        mode = MODES[log.mode[-1]]
        gait = self._gaits[int(extras[2])] if extras[2] >= 0 else ""
        pace = "paused" if extras[1] else f"{extras[0]:.2f} x real time"
        if self._deployed:
            pace = "**disarmed**" if extras[1] else "armed"
        pushed = float(np.linalg.norm(log.push[-1, :3]))
        self._status.content = (
            f"**{mode}** · {gait} · {log.time[-1]:.2f} s · {'looking back' if back < 0.0 else pace}\n\n"
            f"ahead {ahead + 0.0:+.2f} m/s, left {left + 0.0:+.2f} m/s, tilt {log.tilt_deg[-1]:.1f}°"
            + (f", push {pushed:.1f} N" if pushed > 0.0 else "") + self._ended
        )  # fmt: skip

    def _plot(self, log: RunLog) -> None:
        time = log.time
        velocity = _velocity(log)
        wanted = log.command[:, 0]
        effort = np.abs(log.tau / log.effort_limit).max(axis=1)
        values: Sequence[tuple[Array, ...]] = (
            (velocity[:, 0], velocity[:, 1], wanted), (log.base_height,), (log.tilt_deg,), (effort,)
        )  # fmt: skip
        for plot, lines in zip(self._plots.values(), values, strict=True):
            plot.data = (time, *(np.round(line, 3) for line in lines))  # rounding errors are no motion


def _curve(name: str, color: str) -> uplot.Series:
    return uplot.Series(label=name, stroke=color)


def _velocity(log: RunLog) -> Array:
    """Return (n, 2) velocity of the centre of mass ahead and to the left, m/s."""
    x, y = log.momentum[:, :2].T / log.mass_kg
    return np.column_stack(attitude.turn(-heading(log.base_pose[:, 3:]), x, y))
