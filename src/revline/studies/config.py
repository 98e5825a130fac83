"""What a study is asked: engine, operating point, amplitudes, frequencies and tuning goals, with the thesis's as defaults."""

import csv
import math
import sys
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np

from revline.engine.catalogue import engine_names
from revline.errors import InvalidInputError, out_of_range
from revline.io.engine_files import load_engine
from revline.io.texts import read_text
from revline.io.toml_files import TomlFile, parse_toml
from revline.system import DelaySystem

SCHEMA = "revline.study-file/1"
SECTION = "study"
NUMBERS = (
    ("throttle_deg", "deg"),
    ("load_n_m", "N m"),
    ("amplitude_deg", "deg"),
    ("half_range_deg", "deg"),
    ("natural_frequency_rad_s", "rad/s"),
    ("damping_ratio", "1"),
    ("overshoot_limit", "1"),
    ("command_rad_s", "rad/s"),
)
LISTS = ("frequencies_rad_s", "spectrum_frequencies_rad_s", "steps_deg", "map_throttle_deg", "map_load_n_m")
BUILT_IN = "lee1995"
SPECTRA = 6
"""How many spectra a study has: each has its figure."""

MAP_LINES = 20
"""How many angles and loads the map may have."""

WIDE_OPEN = 90.0
"""Throttle angle in deg beyond which there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartingGains:
    """Gains that fine tuning begins from; what is not free stays."""

    kp: float
    ki: float
    kd: float
    free: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyConfig:
    """Questions of a study.

    Attributes:
        engine: name of a built-in engine, or path of an engine file, relative to the working folder unless absolute.
        throttle_deg, load_n_m: operating point.
        amplitude_deg: of the sinusoids.
        half_range_deg: half width of the operating range.
        natural_frequency_rad_s, damping_ratio: of the pole placement for G1.
        overshoot_limit: of fine tuning, as a fraction of the command.
        command_rad_s: step of the speed command; 0 for what the amplitude of the throttle is worth, to two digits.
        steps_deg: throttle steps, up or down.
        spectrum_frequencies, frequencies: in rad/s.
        map_throttle_deg, map_load_n_m: operating points, each angle with each load, over which gains must hold.
    """

    engine: str = BUILT_IN
    throttle_deg: float = 25.0
    load_n_m: float = 0.0
    amplitude_deg: float = 5.0
    half_range_deg: float = 15.0
    natural_frequency_rad_s: float = 18.85
    damping_ratio: float = 1.25
    overshoot_limit: float = 0.09
    command_rad_s: float = 0.0
    steps_deg: tuple[float, ...] = (5.0, 10.0)
    spectrum_frequencies: tuple[float, ...] = (0.01, 0.05, 0.5, 5.0, 20.0, 50.0)
    frequencies: tuple[float, ...] = field(default_factory=lambda: tuple(row["frequency_rad_s"] for row in read_table_4_1()))
    map_throttle_deg: tuple[float, ...] = (14.0, 17.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
    map_load_n_m: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("throttle_deg", 0.0, WIDE_OPEN),
            ("amplitude_deg", 1e-6, 45.0),
            ("half_range_deg", 1e-6, 45.0),
            ("natural_frequency_rad_s", 1e-6, 1e6),
            ("damping_ratio", 1e-3, 1e3),
            ("overshoot_limit", 1e-4, 0.99),
            ("load_n_m", -1e4, 1e4),
            ("command_rad_s", -1e4, 1e4),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise out_of_range(f"study.{name}", value, dict(NUMBERS)[name], f"{low:g} to {high:g}", "mend the study file")
        self._check_angles()
        self._check_map()
        _check_rising("frequencies_rad_s", self.frequencies, 8, math.inf, "at least 8 rising frequencies above 0 rad/s")
        asked = f"{SPECTRA} rising frequencies above 0 rad/s, one for each of Figs 4.4 to 4.9"
        _check_rising("spectrum_frequencies_rad_s", self.spectrum_frequencies, SPECTRA, SPECTRA, asked)

    def _check_angles(self) -> None:
        """Refuse what would move the throttle beyond its range, before anything is computed."""
        moves = [("amplitude_deg", size) for size in (-self.amplitude_deg, self.amplitude_deg)]
        moves += [("half_range_deg", size) for size in (-self.half_range_deg, self.half_range_deg)]
        moves += [("steps_deg", size) for size in self.steps_deg]
        for name, size in moves:
            angle = self.throttle_deg + size
            if not 0.0 <= angle <= WIDE_OPEN:
                message = (
                    f"study.{name}: {size:+g} deg from {self.throttle_deg:g} deg leads to {angle:g} deg, outside the throttle's range of "
                    f"0 to {WIDE_OPEN:g} deg; give less, or another throttle_deg"
                )
                raise InvalidInputError(message, quantity=f"study.{name}", value=angle)
        if not self.steps_deg or 0.0 in self.steps_deg or len(set(self.steps_deg)) < len(self.steps_deg):
            message = "study.steps_deg must be at least one throttle step, none of them 0 and none twice"
            raise InvalidInputError(message, quantity="study.steps_deg")

    def _check_map(self) -> None:
        """Refuse a map that is none."""
        for name, low, high, unit in (("map_throttle_deg", 0.0, WIDE_OPEN, "deg"), ("map_load_n_m", -1e4, 1e4, "N m")):
            values = np.array(getattr(self, name), dtype=float)
            inside = np.isfinite(values).all() and low <= np.min(values, initial=high) and np.max(values, initial=low) <= high
            if not (2 <= values.size <= MAP_LINES and inside and np.all(np.diff(values) > 0.0)):
                message = f"study.{name} must be 2 to {MAP_LINES} rising values from {low:g} to {high:g} {unit}"
                raise InvalidInputError(message, quantity=f"study.{name}")

    @property
    def is_the_thesis(self) -> bool:
        """Whether engine and operating point are those of Lee (1995), so that its numbers can be set beside."""
        return (self.engine, self.throttle_deg, self.load_n_m, self.amplitude_deg) == (BUILT_IN, 25.0, 0.0, 5.0)

    @property
    def has_the_frequencies_of_table_4_1(self) -> bool:
        """Whether the response can be set beside Lee's Table 4.1, line by line."""
        return self.is_the_thesis and self.frequencies == tuple(row["frequency_rad_s"] for row in read_table_4_1())

    @property
    def asks_what_the_thesis_asked(self) -> bool:
        """Whether every question is that of Lee (1995), so that its numbers can be checked and not only shown."""
        return self == StudyConfig()

    @property
    def starting_gains_g2(self) -> StartingGains | None:
        """Hand-tuned gains of Lee (1995), section 5.3; their ki is illegible there and free here."""
        return StartingGains(kp=20.0, ki=247.5, kd=0.4, free=("ki",)) if self.is_the_thesis else None

    @property
    def starting_gains_g2d(self) -> StartingGains | None:
        """Hand-tuned gains of Lee (1995), section 5.4; their ki is illegible there and free here."""
        return StartingGains(kp=1.2, ki=2.0, kd=0.1, free=("ki",)) if self.is_the_thesis else None

    @property
    def engine_title(self) -> str:
        """The engine as a report names it: its built-in name, or its file without the folders of this machine."""
        return Path(self.engine).name

    def load_engine(self) -> DelaySystem:
        """Load the engine that the study is about."""
        return load_engine(self.engine)


def _check_rising(name: str, values: tuple[float, ...], least: int, most: float, asked: str) -> None:
    array = np.array(values, dtype=float)
    if not least <= len(array) <= most or not np.isfinite(array).all() or np.min(array) <= 0.0 or np.any(np.diff(array) <= 0.0):
        message = f"study.{name} must be {asked}"
        raise InvalidInputError(message, quantity=f"study.{name}")


def read_config(path: Path) -> StudyConfig:
    """Read a study file.

    Example of one:

        schema = "revline.study-file/1"
        [study]
        engine = "my_engine.toml"       # built-in name, or a path relative to the study file
        throttle_deg = 20.0
        amplitude_deg = 3.0
        frequencies_rad_s = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0]

    Raises:
        InvalidInputError: the file cannot be read, has an unknown key, a wrong type or a value out of range, or names an engine that is
            neither built in nor a file. Messages name file, line and remedy.
    """
    text = read_text(path, "study file")
    file = parse_toml(text, place=f"study file {path}", schema=SCHEMA, remedy="see the documentation of study files")
    file.refuse_unknown("", ["schema", SECTION])
    file.refuse_unknown(SECTION, ["engine", *(name for name, _ in NUMBERS), *LISTS])
    given = file.table(SECTION)
    found: dict[str, object] = {name: file.number(SECTION, name, unit) for name, unit in NUMBERS if name in given}
    for name in LISTS:
        if name in given:
            found[name.removesuffix("_rad_s")] = _numbers(file, name)
    if "engine" in given:
        found["engine"] = _engine(file, path.parent)
    try:
        return StudyConfig(**found)  # type: ignore[arg-type]  # each entry was read by its own type above
    except InvalidInputError as error:
        key = str(error.details["quantity"]).removeprefix(f"{SECTION}.")
        raise file.error(SECTION, key, str(error)) from error


def _engine(file: TomlFile, folder: Path) -> str:
    """Name of a built-in engine, or path of a file that lies where the study file says, seen from its own folder."""
    engine = file.line_of_text(SECTION, "engine")
    if engine in engine_names():
        return engine
    beside = folder / engine
    if not beside.is_file():
        message = (
            f"study.engine = {engine!r} is no built-in engine ({', '.join(engine_names())}), and there is no file {beside}; mend the name"
        )
        raise file.error(SECTION, "engine", message)
    return str(beside)


def _numbers(file: TomlFile, name: str) -> tuple[float, ...]:
    value = file.value(SECTION, name, "a list of numbers")
    if not (isinstance(value, list) and all(map(_is_finite_number, value))):
        message = f"study.{name} = {value!r} is no list of finite numbers; write for example [0.1, 1.0, 10.0]"
        raise file.error(SECTION, name, message)
    return tuple(map(float, value))


def _is_finite_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def reference_text(name: str) -> str:
    """Text of one of the thesis's tables that the package carries."""
    return (resources.files("revline.studies") / "reference" / name).read_text(encoding="utf-8")


def read_table_4_1() -> tuple[dict[str, float], ...]:
    """Rows of Table 4.1 of Lee (1995): frequency, amplitude of the speed, lag in degrees."""
    return tuple({key: float(value) for key, value in row.items()} for row in csv.DictReader(reference_text("table_4_1.csv").splitlines()))
