import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine.catalogue import ENGINES, CatalogueEntry, build_engine
from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, EngineParameters, lee1995
from revline.errors import InvalidInputError
from revline.io.engine_files import format_engine, load_engine, parse_engine, read_engine, write_engine
from revline.io.engine_vectors import format_engine_vector
from revline.system import DelaySystem

TEXT = format_engine(lee1995())
finite = st.floats(allow_nan=False, allow_infinity=False)


def edited(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


def line_of(start: str) -> int:
    return next(number for number, line in enumerate(TEXT.split("\n"), start=1) if line.startswith(start))


@pytest.mark.parametrize("entry", ENGINES, ids=lambda entry: entry.name)
def test_a_built_in_engine_reads_back_equal(entry: CatalogueEntry, tmp_path: Path) -> None:
    engine = entry.build()
    write_engine(engine, tmp_path / "e.toml")
    again = read_engine(tmp_path / "e.toml")
    assert again.name == engine.name == entry.name
    assert again.parameters == engine.parameters
    assert again.content_digest == engine.content_digest


@given(offset=finite, constant=finite, volume=st.floats(min_value=5e-324, allow_infinity=False), name=st.text(min_size=1))
def test_numbers_and_names_read_back_to_the_last_bit(offset: float, constant: float, volume: float, name: str) -> None:
    parameters = LEE_1995._replace(
        throttle=LEE_1995.throttle._replace(angle_offset=offset),
        manifold=LEE_1995.manifold._replace(volume=volume),
        friction=LEE_1995.friction._replace(constant=constant),
    )
    name = name if name.isprintable() and name.strip() else "n"
    again = parse_engine(format_engine(replace(lee1995(parameters), name=name)))
    assert again.name == name
    assert [number.hex() for number in numbers(again)] == [number.hex() for number in numbers(lee1995(parameters))]


def numbers(engine: DelaySystem) -> list[float]:
    return [value for part in engine.parameters for value in part]


def test_whole_numbers_are_read_as_floats() -> None:
    engine = parse_engine(edited("temperature = 310.0", "temperature = 310"))
    assert isinstance(engine.parameters.manifold.temperature, float)
    assert engine.content_digest == lee1995().content_digest


def test_every_parameter_has_unit_meaning_and_source() -> None:
    for text in (TEXT, format_engine(build_engine("lee1995-generic"))):
        parameters = [line for line in text.split("\n") if " = " in line and '"' not in line]
        assert len(parameters) == sum(len(part) for part in LEE_1995)
        for line in parameters:
            unit, meaning, source = line.partition(" # ")[2].split("; ", maxsplit=2)
            assert unit
            assert len(meaning) > 8
            assert "(19" in source


def test_comments_state_unit_and_source() -> None:
    line = "inertia = 0.1454 # kg m2; inertia of engine and load; Lee (1995), eq. 2.17; Cho and Hedrick (1989)"
    assert line in TEXT.split("\n")


def test_the_name_may_be_left_out(tmp_path: Path) -> None:
    path = tmp_path / "big_block.toml"
    path.write_text(edited('name = "lee1995"\n', ""))
    assert read_engine(path).name == "big_block"


def test_sections_may_stand_in_any_order_and_form() -> None:
    inline = edited("[rotation]\ninertia = 0.1454 #", "#").replace("[engine]", "rotation.inertia = 0.25\n\n[engine]")
    assert parse_engine(inline).parameters.rotation.inertia == 0.25


def test_generic_efficiency_takes_its_own_coefficients() -> None:
    engine = parse_engine(format_engine(lee1995(LEE_1995._replace(efficiency=GENERIC_EFFICIENCY))))
    assert engine.parameters.efficiency == GENERIC_EFFICIENCY


NUMBERS = [
    ("volume = -1.0", "manifold.volume = -1 m3 is outside the range above 0 m3; give a value above 0"),
    ("inertia = 0", "rotation.inertia = 0 kg m2 is outside the range above 0 kg m2; give a value above 0"),
    ("saturation_angle = 91", "throttle.saturation_angle = 91 deg is outside 0 to 90 deg; a throttle opens no further"),
    ("viscous = nan", "friction.viscous = nan is no finite number; give one in N m s/rad"),
    ("viscous = -inf", "friction.viscous = -inf is no finite number; give one in N m s/rad"),
    ("viscous = 1e999", "friction.viscous = inf is no finite number; give one in N m s/rad"),
    (f"viscous = 1{'0' * 400}", "friction.viscous is too large an integer; give a number in N m s/rad"),
    ("viscous = true", "friction.viscous = true is a boolean; give a number in N m s/rad, without quotes"),
    ('viscous = "0.1"', "friction.viscous = '0.1' is a text; give a number in N m s/rad, without quotes"),
    ("viscous = [1.0]", "friction.viscous = [1.0] is an array; give a number"),
    ("viscous = {a = 1}", "friction.viscous = {'a': 1} is a table; give a number"),
    ("viscous = 2024-01-01", "friction.viscous = datetime.date(2024, 1, 1) is a date or time; give a number"),
]
"""A line that replaces the one of its key, and the message that it must give."""

KEYS = [
    ("viscous", "viscose = 0.1", "unknown key friction.viscose, did you mean viscous?; known are constant, viscous"),
    ("viscous", "qqq = 0.1", "unknown key friction.qqq; known are constant, viscous"),
    ("[friction]", "[frictions]", "unknown key or section frictions, did you mean friction?; known are schema, engine, throttle"),
    ("schema", 'schema = "revline.engine/2"', "schema = 'revline.engine/2' cannot be read; this version reads \"revline.engine/1\""),
    ("schema", "schema = 1", 'schema = 1 cannot be read; this version reads "revline.engine/1"'),
    ("model", 'model = "lee1996"', 'engine.model = "lee1996" is unknown, did you mean lee1995?; there are "lee1995"'),
    ("model", "model = 1995", "engine.model = 1995 is an integer; give a text in quotes"),
    (
        "efficiency_model",
        'efficiency_model = "gene"',
        'engine.efficiency_model = "gene" is unknown, did you mean generic?; there are "thesis"',
    ),
    ("name", 'name = " "', "engine.name = ' ' is no printable text of one line; give one"),
    ("name", 'title = "lee1995"', "unknown key engine.title; known are name, model, efficiency_model"),
]
"""The start of a line, what replaces that line, and the message that it must give."""


def with_line(start: str, new: str) -> str:
    lines = TEXT.split("\n")
    lines[line_of(start) - 1] = new
    return "\n".join(lines)


@pytest.mark.parametrize(("start", "new", "message"), [(line.split()[0], line, message) for line, message in NUMBERS] + KEYS)
def test_an_error_names_line_key_value_and_remedy(start: str, new: str, message: str) -> None:
    expected = f"engine file e, line {line_of(start)}: {message}"
    with pytest.raises(InvalidInputError, match=f"^{re.escape(expected)}"):
        parse_engine(with_line(start, new), place="engine file e")


def test_coefficients_of_another_efficiency_are_unknown() -> None:
    text = with_line("efficiency_model", 'efficiency_model = "generic"')
    with pytest.raises(InvalidInputError, match=r"unknown key efficiency\.mass_squared_speed.*; known are line_constant, line_slope"):
        parse_engine(text)


def test_a_missing_key_is_named_with_its_section() -> None:
    message = r"friction\.viscous is missing; add viscous = <number in N m s/rad> under \[friction\] \(`revline engines lee1995` prints"
    with pytest.raises(InvalidInputError, match=rf"^engine file, line {line_of('[friction]')}: {message}"):
        parse_engine(with_line("viscous", ""))


def test_a_missing_section_is_named() -> None:
    text = TEXT[: TEXT.index("[rotation]")]
    with pytest.raises(
        InvalidInputError, match=r"section \[rotation\] is missing; add it \(`revline engines lee1995` prints a complete file\)"
    ):
        parse_engine(text)


def test_a_value_in_a_sections_place_is_named() -> None:
    text = TEXT[: TEXT.index("[rotation]")].replace("[engine]", "rotation = 3\n\n[engine]")
    with pytest.raises(
        InvalidInputError, match=r"line 3: rotation = 3 is an integer, not a section; write \[rotation\] with its keys below"
    ):
        parse_engine(text)


def test_a_missing_schema_is_named() -> None:
    with pytest.raises(InvalidInputError, match=r'schema is missing; add schema = <"revline.engine/1"> at the top'):
        parse_engine(TEXT.split("\n", maxsplit=1)[1])


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("volume = 0.0027", "volume = 0,0027", "volume"),
        ("volume = 0.0027", "volume 0.0027", "volume"),
        ("[rotation]", "[friction]", "[rotation]"),
        ("viscous = 0.1056", "constant = 1", "viscous"),
    ],
)
def test_bad_syntax_is_refused_with_its_line(old: str, new: str, line: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"^engine file e is no valid TOML: .*\(at line {line_of(line)}, .*; mend that line"):
        parse_engine(edited(old, new), place="engine file e")


def test_nesting_without_end_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"no valid TOML: .*recursion"):
        parse_engine("a = " + "[" * 100_000)


def test_a_key_that_cannot_be_located_is_refused_without_a_line() -> None:
    text = edited("[rotation]\ninertia = 0.1454 #", "#").replace("[engine]", "rotation = { inertia = -1.0 }\n\n[engine]")
    with pytest.raises(InvalidInputError, match=r"^engine file: rotation\.inertia = -1 kg m2 is outside"):
        parse_engine(text)


def test_errors_carry_section_key_and_line() -> None:
    with pytest.raises(InvalidInputError) as caught:
        parse_engine(edited("inertia = 0.1454", "inertia = 0"))
    assert (caught.value.details["section"], caught.value.details["key"]) == ("rotation", "inertia")
    assert caught.value.details["line"] == line_of("inertia")


def test_an_engine_with_equations_of_its_own_is_not_written() -> None:
    engine = lee1995()
    with pytest.raises(
        InvalidInputError, match=r"lee1995 differs from the engine of Lee \(1995\) in its equation_digest, beyond parameters"
    ):
        format_engine(replace(engine, lags=lambda p, x, u, zd: (1.0 / x[1], 1.0 / x[1])))  # noqa: ARG005 - the form of all equations
    nominal = replace(engine.inputs[0], nominal=30.0)
    with pytest.raises(InvalidInputError, match="in its inputs, beyond parameters: keep it as Python code"):
        format_engine(replace(engine, inputs=(nominal, *engine.inputs[1:])))


def test_another_model_is_not_written() -> None:
    other = DelaySystem(
        name="lag", parameters=(1.0,), states=(), inputs=(), channels=(), outputs=(), emit=none, lags=none, rate=none, output=none
    )
    with pytest.raises(InvalidInputError, match=r"lag is no engine of Lee \(1995\): its parameters are tuple, not EngineParameters"):
        format_engine(other)


def none(p: object, x: object, u: object, zd: object) -> tuple[()]:  # noqa: ARG001 - the form of all equations
    return ()


@pytest.mark.parametrize("name", ["", "two\nlines"])
def test_an_unprintable_name_is_not_written(name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"is no printable text of one line; give it another with dataclasses\.replace"):
        format_engine(replace(lee1995(), name=name))


def test_load_engine_knows_names_and_both_kinds_of_file(tmp_path: Path) -> None:
    assert load_engine("lee1995-generic").parameters.efficiency == GENERIC_EFFICIENCY
    slow = EngineParameters(*LEE_1995[:-1], rotation=LEE_1995.rotation._replace(inertia=2.0))
    write_engine(lee1995(slow), tmp_path / "slow.TOML")
    assert load_engine(tmp_path / "slow.TOML").parameters == slow
    for suffix in ("txt", "vec", "dat"):
        path = tmp_path / f"slow.{suffix}"
        path.write_text(format_engine_vector(lee1995(slow)).text)
        assert load_engine(str(path)).parameters == slow


@pytest.mark.parametrize("name", ["lee_1995", "lee1995.json", "", "."])
def test_what_is_no_engine_is_explained_both_ways(name: str) -> None:
    nearest = ", did you mean lee1995\\?" if name.startswith("lee") else ""
    both = r"give a built-in engine \(lee1995, lee1995-generic\), an engine file ending in \.toml, or a vector .* in \.txt, \.vec, \.dat"
    with pytest.raises(InvalidInputError, match=f"^there is no engine '{name}'{nearest}; {both}"):
        load_engine(name)


def test_a_missing_engine_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"engine file .*e\.toml does not exist"):
        load_engine(tmp_path / "e.toml")


@pytest.mark.reference
def test_the_written_engine_is_the_thesiss() -> None:
    """Source: Lee (1995), the vector of 24 numbers."""
    engine = parse_engine(TEXT)
    assert math.isclose(engine.parameters.manifold.gas_constant, 0.288292, abs_tol=5e-7)
    assert engine.parameters.efficiency == (24.5, -3.1e4, -0.167, 222.0, 8.1e-4, 0.352)
