"""Controls of the page: status, buttons, sliders, menus, keys, and the state as file and link."""

import html
from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from omni_control.controllers.registry import get_parameters, list_available_controllers
from omni_control.errors import OmniError
from omni_mj.config import PERIOD_S, faults, plugins
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import find_setting
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.mjcf.field import ROBOT_RADIUS_M
from omni_mj.play.field_view import FieldView
from omni_mj.play.live_plots import LivePlots
from omni_mj.play.play_session import MAX_CONTROLLERS
from omni_mj.play.state_links import format_link
from omni_mj.viz.recording import scene

if TYPE_CHECKING:
    import viser

    from omni_mj.play.play_server import PlayServer

PANEL_PX, PLOTS_PX = 340, 330
MAX_PHONE_PX, MIN_VIEW_PX = 576, 120  # as in viser
SPEEDS = {"1": 1.0, "1/2": 0.5, "1/5": 0.2, "1/20": 0.05}
DRIVE_SPEED_M_S, DRIVE_TURN_RAD_S = 0.8, 2.5
CONTROLLER_MENUS = [f"Controller {i + 1}" for i in range(MAX_CONTROLLERS)]
NONE = "none"
MIN_REAL_TIME_FACTOR = 0.9  # of the chosen speed; below it, the page says so


class SliderInfo(NamedTuple):
    """A slider of a setting.

    Attributes:
        label: Text with the unit.
        scale: Value on the slider over value of the setting.
        low: Left end.
        high: Right end, extended if the setting exceeds it.
        step: Step.
        default: Value of a controller's parameter without a setting.
    """

    label: str
    scale: float
    low: float
    high: float
    step: float
    default: float = 0.0


SLIDERS = {
    "radio.delay_frames": SliderInfo("Dead time, s", PERIOD_S, 0.0, 0.3, PERIOD_S),
    "radio.loss_probability": SliderInfo("Radio loss, %", 100.0, 0.0, 50.0, 1.0),
    "vision.position_noise_m": SliderInfo("Vision noise, mm", 1e3, 0.0, 30.0, 0.1),
    "carpet.friction": SliderInfo("Friction", 1.0, 0.05, 1.5, 0.05),
    "drivetrain.creep_stiffness": SliderInfo("Creep stiffness", 1.0, 0.5, 20.0, 0.1),
    "battery.charge": SliderInfo("Battery, %", 100.0, 0.0, 100.0, 1.0),
    "control.error_range_m": SliderInfo("Fuzzy error, mm", 1e3, 10.0, 500.0, 5.0),
    "control.speed_range_m_s": SliderInfo("Fuzzy v, m/s", 1.0, 0.1, 3.0, 0.05),
    "control.heading_gain": SliderInfo("Heading gain, 1/s", 1.0, 0.0, 20.0, 0.1),
}
# Label -> key, and direction of driving on the screen: along x, along y, turn. Arrows, and
# W, A, S, D, Q and E, move viser's camera; arrows also change the slider in focus.
DRIVE_KEYS: dict[str, tuple[Any, tuple[int, int, int]]] = {
    "\u2190": ("J", (-1, 0, 0)),
    "\u2191": ("I", (0, 1, 0)),
    "\u2193": ("K", (0, -1, 0)),
    "\u2192": ("L", (1, 0, 0)),
    "\u21ba": ("U", (0, 0, 1)),
    "\u21bb": ("O", (0, 0, -1)),
    "Stop": ("X", (0, 0, 0)),
}


class PlayPage:
    """Controls and views of a session, which all connected browsers share.

    Args:
        play: Server that carries out requests.
        web: The server, a `viser.ViserServer`.

    Attributes:
        view: The 3-D view.
        plots: The live plots.
    """

    def __init__(self, play: "PlayServer", web: Any) -> None:
        self._play, self._web, self._gui = play, web, web.gui
        # Whether a browser is a phone, and width over height of its 3-D view, by its number
        self._windows: dict[int, tuple[bool, float]] = {}
        self._message, self._build_key = "", list[Any]()
        self._shown_scenario: Scenario | None = None
        self._elements = list[Any]()  # to remove before the next build
        self._loss_boxes: dict[type, Any] = {}
        self._menus: dict[str, Any] = {}
        gui = self._gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label("omni-mj play")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        self._status = gui.add_html("")
        self._add_buttons(
            "pause",
            {"Pause": self._pause, "Continue": self.resume, "Restart": self._restart},
        )
        self._speed = gui.add_dropdown("Speed", list(SPEEDS), hint="simulated time over real time")
        self._on(self._speed.on_update, "pause", lambda _: self.resume())
        repeat = gui.add_checkbox("Repeat", play.repeat, hint="restart when the reference ends")
        self._on(repeat.on_update, "repeat", self._set_repeat)
        self._sliders: dict[str, Any] = {}
        self._settings = gui.add_folder("Settings")
        self._add_disturbances()
        self._add_driving()
        self._add_menus()
        with gui.add_folder("State", expand_by_default=False):
            self._link = gui.add_text("Link", "", multiline=True)
            gui.add_button("Download scenario").on_click(self._download)
        panel = gui.add_panel()
        self._plot_tab = panel.add_tab("Plots")
        panel.dock_left()
        panel.set_width(PLOTS_PX)
        panel.expand()  # on phones
        self._shown_area: Any = None
        web.scene.on_click()(self._set_target)
        self.refresh()
        web.on_client_connect(self._greet)

    def refresh(self, key: str = "") -> None:
        """Show the session as it is after the request of a key."""
        session = self._play.session
        if session.scenario is not self._shown_scenario:
            self._show_scenario(session.scenario)
        for name, slider in self._sliders.items():
            if name != key or self._message:
                slider.value = self._slider_value(name)
        for label, value in self._menu_values().items():
            self._menus[label].value = value
        for kind, box in self._loss_boxes.items():
            box.value = bool(session.list_faults(kind))

    def _show_scenario(self, scenario: Scenario) -> None:
        """Show a scenario, or the same one with other settings."""
        self._shown_scenario = scenario
        settings, unset = scenario.settings, scenario.model_copy(update={"settings": None})
        build_key = [unset, settings.reference, settings.world, settings.mechanics]
        if build_key != self._build_key:
            self._build_key = build_key
            self._rebuild()
        try:
            self._link.value = f"{self._play.url}?{format_link(scenario)}"
        except OmniError:  # a user's file, or faults
            self._link.value = "A link cannot hold this state; download the scenario instead."

    def resume(self) -> None:
        """Let robots drive at the chosen speed."""
        self._play.speed = SPEEDS[self._speed.value]

    def show_message(self, text: str) -> None:
        """Show an error or a remark until the next request."""
        self._message = text

    def show_status(self, real_time_factor: float) -> None:
        """Show time, errors, failures and speed."""
        play, snapshot = self._play, self._play.session.snapshot
        self.plots.send()
        if play.speed and real_time_factor < MIN_REAL_TIME_FACTOR * play.speed:
            state = f"too slow: runs at {real_time_factor:.2f} x real time"
        elif not play.speed:
            state = "paused"
        else:
            state = "the reference has ended; the robots rest" * snapshot.has_ended
        rows = "".join(
            f'<tr><td style="color:rgb{color}">&#9632; {html.escape(label)}</td>'
            + "".join(f'<td align="right">{f"{x:.1f}".replace("nan", "")}</td>' for x in errors)
            for label, color, *errors in zip(
                play.session.labels,
                play.session.colors,
                100 * snapshot.error_m,
                self.plots.rms_error_cm(),
                strict=True,
            )
        )
        lines = "".join(
            f'<div style="color:#c00;overflow-wrap:anywhere">{html.escape(text)}</div>'
            for text in (self._message, *snapshot.failures)
            if text
        )
        self._status.content = (
            f'<div style="padding:0 1em;font-size:0.9em"><b>{snapshot.time_s:.1f} s</b> {state}'
            f'<table width="100%"><tr><td></td><td align="right">error, cm</td>'
            f'<td align="right">rms of 10 s</td></tr>{rows}</table>{lines}'
            f'<div style="color:gray">arrows: error x {scene.ERROR_SCALE}; '
            "pale: predicted pose</div></div>"
        )

    def _rebuild(self) -> None:
        """Build everything that depends on scenario, robot and controllers."""
        for element in self._elements:
            element.remove()
        session = self._play.session
        self.view = FieldView(self._web.scene, session)
        area = [*self.view.center, self.view.size_m]
        if area != self._shown_area:
            self._shown_area = area
            for number, client in self._web.get_clients().items():
                if number in self._windows:  # not only just connected
                    self._place_camera(client)
        with self._plot_tab:
            self.plots = LivePlots(self._gui, session)
        self._add_sliders()
        self._elements = [*self.plots.handles, *self._sliders.values()]

    def _add_sliders(self) -> None:
        """Add a slider for each setting, and for the parameters of the controllers."""
        infos = dict(SLIDERS)
        for spec in self._play.session.scenario.controllers:
            label = plugins.label_controller(spec)
            for parameter, value in get_parameters(plugins.find_controller(spec)).items():
                name = f"controller.{label}.{parameter}"
                if type(value) is float and value > 0:
                    infos[name] = SliderInfo(name[11:], 1.0, 0.0, 4 * value, value / 20, value)
        self._infos, self._sliders = infos, {}
        for name, info in infos.items():
            value = self._slider_value(name)
            low, high = min(info.low, value), max(info.high, value)
            hint = f"{name}: {find_setting(name).doc}" if name in SLIDERS else name
            with self._settings:
                slider = self._gui.add_slider(info.label, low, high, info.step, value, hint=hint)
            slider.precision = 3
            self._sliders[name] = slider
            self._on(slider.on_update, name, partial(self._change, name))

    def _slider_value(self, name: str) -> float:
        """Return the value of a setting on its slider."""
        settings = self._play.session.scenario.settings
        if name in SLIDERS:
            return float(attrgetter(name)(settings)) * self._infos[name].scale
        _, label, parameter = name.split(".")
        return float(settings.controller.get(label, {}).get(parameter, self._infos[name].default))

    def _change(self, name: str, value: float) -> None:
        """Change a setting to a value on its slider."""
        label, scale = self._infos[name][:2]
        if name in SLIDERS:
            setting = find_setting(name)
            low, high = scale * setting.low, scale * setting.high
            if not low <= value <= high:
                raise OmniError(f"{label} must be {low:g} to {high:g}, got {value:g}")
        if not self._play.session.change(name, round(value / scale, 6)):
            self.show_message(f"Restarted, because {name} cannot change while robots drive.")

    def _add_menus(self) -> None:
        """Add menus for scenario, robot, plant and controllers; a user's own are those at first."""
        scenario = self._play.session.scenario
        specs = map(_format, scenario.controllers)
        names = {
            "Scenario": [*find_builtin_files("scenarios"), scenario.name],
            "Robot": [*find_builtin_files("robots"), scenario.robot],
            "Plant": [*plugins.PLANTS, scenario.plant],
        }
        controllers = [NONE, *list_available_controllers(), *specs]
        names |= {label: controllers for label in CONTROLLER_MENUS}
        values = self._menu_values()
        with self._gui.add_folder("Scenario and controllers"):
            for label, options in names.items():
                options = [name for name in dict.fromkeys(options) if name != "live"]  # for drive
                menu = self._gui.add_dropdown(label, options, initial_value=values[label])
                self._on(menu.on_update, "menu", partial(self._load, label))
                self._menus[label] = menu

    def _menu_values(self) -> dict[str, str]:
        """Return what the menus show."""
        scenario = self._play.session.scenario
        specs = [*map(_format, scenario.controllers), NONE, NONE]
        values = {"Scenario": scenario.name, "Robot": scenario.robot, "Plant": scenario.plant}
        return values | dict(zip(CONTROLLER_MENUS, specs, strict=False))

    def _load(self, label: str, value: str) -> None:
        """Load what the menus say, after a change of one."""
        values, scenario = self._menu_values() | {label: value}, self._play.session.scenario
        present = {_format(spec): spec for spec in scenario.controllers}
        chosen = [values[menu] for menu in CONTROLLER_MENUS if values[menu] != NONE]
        specs = [present.get(name, name) for name in chosen]  # files may have errors now
        if not specs:
            raise OmniError("choose at least one controller")
        if label in ("Scenario", "Robot"):
            top_level = {"controllers": specs, "plant": scenario.plant}
            if label == "Robot":
                top_level["robot"] = value
            self._play.load(values["Scenario"], top_level)
            self.show_message(f"The settings are those of the {label.lower()} {value} again.")
        else:  # the backend depends on the plant
            settings = scenario.settings.replace(physics={"backend": "auto"})
            scenario = scenario.replace(plant=values["Plant"], settings=settings)
            self._play.session.restart(scenario, specs)
        self.resume()

    def _add_disturbances(self) -> None:
        """Add what can happen to the robots."""
        session, gui = self._play.session, self._gui
        with gui.add_folder("Disturb"):
            actions = {
                "Push": session.push,
                "Spill debris": session.spill_debris,
                "Carry away": session.carry_away,
            }
            self._add_buttons("disturb", actions)
            losses: dict[str, type[faults.Fault]] = {
                "Radio lost": faults.RadioLoss,
                "Camera lost": faults.VisionLoss,
            }
            for label, kind in losses.items():
                box = gui.add_checkbox(label, initial_value=False)
                self._on(box.on_update, label, partial(session.set_lost, kind))
                self._loss_boxes[kind] = box

    def _add_driving(self) -> None:
        """Add buttons and keys to drive the robots by hand."""
        session, gui = self._play.session, self._gui

        def drive(label: str) -> None:
            x, y, turn = DRIVE_KEYS[label][1]
            session.set_velocity(DRIVE_SPEED_M_S * x, DRIVE_SPEED_M_S * y, DRIVE_TURN_RAD_S * turn)

        with gui.add_folder("Drive"):
            gui.add_markdown(
                "Click on the field to set a target. Keys, unless a menu or box is in use: I, J, "
                "K, L; U, O turn; X stops. Restart follows the scenario again."
            )
            self._add_buttons("drive", {label: partial(drive, label) for label in DRIVE_KEYS})
        for label, (key, _) in DRIVE_KEYS.items():
            action = partial(self._play.request, "drive", partial(drive, label))
            command = gui.add_command(f"Drive {label}", hotkey=key)
            command.on_trigger(lambda _, action=action: action())

    def _set_target(self, event: "viser.SceneClickEvent") -> None:
        """Drive to the point of the carpet that was clicked."""
        origin, direction = np.array(event.ray_origin), np.array(event.ray_direction)
        if direction[2] >= 0:
            return
        x, y, _ = origin - origin[2] / direction[2] * direction
        carpet_size_m = self._play.session.scenario.settings.world.carpet_size_m
        if (np.abs([x, y]) <= np.array(carpet_size_m) / 2 - ROBOT_RADIUS_M).all():
            self._play.request("drive", lambda: self._play.session.set_target(float(x), float(y)))

    def _pause(self) -> None:
        self._play.speed = 0.0

    def _restart(self) -> None:
        self._play.session.restart()
        self.resume()

    def _set_repeat(self, is_on: bool) -> None:
        self._play.repeat = is_on

    def _download(self, event: Any) -> None:
        """Send the state to the browser as a scenario file."""
        scenario = self._play.session.scenario
        event.client.send_file_download(
            f"{scenario.name}.toml", scenario.to_toml().encode(), save_immediately=True
        )

    def _greet(self, client: "viser.ClientHandle") -> None:
        """Store the window of a new page, whose panels are not open yet, and place its camera."""
        camera = client.camera
        is_phone = camera.image_width < MAX_PHONE_PX
        view_px = camera.image_width - (0 if is_phone else PANEL_PX + PLOTS_PX)
        self._windows[client.client_id] = is_phone, max(view_px, MIN_VIEW_PX) / camera.image_height
        self._place_camera(client)

    def _place_camera(self, client: "viser.ClientHandle") -> None:
        """Let a page look at the reference, from farther away in a narrow view."""
        is_phone, aspect = self._windows[client.client_id]
        x, y = self.view.center
        distance = 0.65 * self.view.size_m * max(1.0, 0.95 / aspect)
        client.camera.position = (x, y - 0.8 * distance, 0.8 * distance)
        # On phones, the controls cover the lower half.
        client.camera.look_at = (x, y - 0.5 * distance * is_phone, 0.0)

    def _add_buttons(self, key: str, actions: Mapping[str, Callable[[], None]]) -> None:
        """Add a row of buttons, by their labels, whose actions are requests of a key."""
        group = self._gui.add_button_group("", list(actions))
        self._on(group.on_click, key, lambda label: actions[label]())

    def _on(self, register: Callable[[Any], Any], key: str, action: Callable[[Any], None]) -> None:
        """Request an action, given the new value, when a control is used."""

        def call(event: Any) -> None:
            if event.client is not None:  # not set by `refresh`
                value = event.target.value
                self._play.request(key, lambda: action(value))

        register(call)


def _format(spec: plugins.ControllerSpec) -> str:
    """Return a controller as in menus: its name, or its file and class."""
    return plugins.format_controller_spec(spec).removeprefix(f"{Path.cwd()}/")
