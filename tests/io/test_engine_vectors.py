from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine.catalogue import build_engine
from revline.engine.lee1995 import LEE_1995, EngineParameters, lee1995
from revline.errors import InvalidInputError
from revline.io.engine_vectors import VECTOR, format_engine_vector, parse_engine_vector, read_engine_vector, write_engine_vector

THESIS = (
    "0.0027 310 79.46 1.14459 -1.06 0.1843 24.5 -3.1e4 -0.167 222 8.1e-4 0.352 0 0.112 7.3834 13.5 10 2.875 5.48 1.30 498636 "
    "15.1 0.1056 0.1454"
)


@pytest.mark.reference
def test_the_thesiss_vector_is_the_built_in_engine() -> None:
    """Source: Lee (1995), the parameter file of its program, with -3.1e4 after Cho and Hedrick (1989)."""
    assert parse_engine_vector(THESIS).content_digest == lee1995().content_digest


def test_the_order_is_the_thesiss() -> None:
    engine = parse_engine_vector(" ".join("0" if position == 12 else str(position + 1) for position in range(24)))
    p = engine.parameters
    assert p.manifold[:2] == (1.0, 2.0)
    assert (p.throttle.saturation_angle, p.throttle.angle_slope, p.throttle.angle_offset, p.throttle.max_flow) == (3.0, 4.0, 5.0, 6.0)
    assert p.efficiency == (7.0, 8.0, 9.0, 10.0, 11.0, 12.0)
    assert (*p.cylinders, *p.mixture, *p.spark, *p.delays) == (14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0)
    assert (*p.combustion, *p.friction, *p.rotation) == (21.0, 22.0, 23.0, 24.0)
    assert (p.throttle.ambient_pressure, p.throttle.pressure_exponent, p.manifold.gas_constant) == (100.0, 9.0, 8.31434 / 28.84)


def test_numbers_stand_apart_by_blanks_commas_and_lines_with_comments() -> None:
    words = THESIS.split()
    text = "% the engine\n# of 1995\n\n" + ", ".join(words[:5]) + ",  # air\n" + "\t".join(words[5:9]) + "\r\n"
    text += "\n".join(words[9:20]) + " % 0.5 1\n" + " ,".join(words[20:]) + "#9"
    assert parse_engine_vector(text).parameters == LEE_1995


@given(st.lists(st.floats(min_value=1e-300, max_value=90.0), min_size=23, max_size=23))
def test_a_vector_reads_back_to_the_last_bit(values: list[float]) -> None:
    values.insert(12, 0.0)
    engine = parse_engine_vector(" ".join(map(repr, values)))
    vector = format_engine_vector(engine)
    assert vector.notes == ()
    assert [line.split()[0] for line in vector.text.splitlines()[1:]] == [repr(value) for value in values]
    assert parse_engine_vector(vector.text).parameters == engine.parameters


def test_each_number_is_explained() -> None:
    lines = format_engine_vector(lee1995()).text.splitlines()
    assert len(lines) == 1 + len(VECTOR) == 25
    assert lines[1] == "0.0027 # 1: manifold.volume, m3; volume of the intake manifold"
    assert lines[13] == "0.0 # 13: reserve, always 0"


def test_what_the_vector_cannot_hold_is_noted(tmp_path: Path) -> None:
    throttle = LEE_1995.throttle._replace(ambient_pressure=95.0, pressure_exponent=8.5)
    engine = lee1995(EngineParameters(throttle, *LEE_1995[1:]))
    vector = write_engine_vector(engine, tmp_path / "high.vec")
    assert vector.notes == (
        "throttle.pressure_exponent = 8.5 1 is not in the vector: reading it back gives 9.0 1",
        "throttle.ambient_pressure = 95.0 kPa is not in the vector: reading it back gives 100.0 kPa",
    )
    again = read_engine_vector(tmp_path / "high.vec")
    assert again.name == "high"
    assert again.parameters == LEE_1995


def test_the_generic_efficiency_does_not_fit() -> None:
    with pytest.raises(
        InvalidInputError, match=r"lee1995-generic: the vector of 24 numbers cannot hold the generic efficiency; write .*toml"
    ):
        format_engine_vector(build_engine("lee1995-generic"))


@pytest.mark.parametrize("count", [0, 23, 25])
def test_a_wrong_count_is_refused(count: int) -> None:
    words = [*THESIS.split(), "1"][:count]
    with pytest.raises(
        InvalidInputError, match=f"engine vector holds {count} numbers where the vector has 24, from manifold volume to inertia"
    ):
        parse_engine_vector(" ".join(words))


def test_a_reserve_that_is_used_is_refused() -> None:
    text = "\n".join(THESIS.split()[:12]) + "\n0.5 " + " ".join(THESIS.split()[13:])
    with pytest.raises(InvalidInputError, match=r"line 13: number 13, the reserve, is 0\.5; nothing uses it, so give 0"):
        parse_engine_vector(text)


@pytest.mark.parametrize("word", ["nan", "inf", "1_0", "0x1", "1d-4", "true", "schema", "1.5.2", "--1", "\u0663", "[1"])
def test_what_is_no_number_is_refused_with_its_line(word: str) -> None:
    with pytest.raises(
        InvalidInputError, match=r"^engine vector v, line 2: '.*' is no number; give 24 numbers apart by blanks, commas or new"
    ):
        parse_engine_vector(f"0.0027\n310 {word}", place="engine vector v")


def test_an_empty_place_between_commas_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="line 1: '' is no number"):
        parse_engine_vector("0.0027, , 310")


def test_a_parameter_out_of_range_is_named_with_line_and_position() -> None:
    text = "\n".join([*THESIS.split()[:23], "-0.1"])
    with pytest.raises(
        InvalidInputError, match=r"line 24: number 24: rotation\.inertia = -0\.1 kg m2 is outside the range above 0 kg m2; give"
    ):
        parse_engine_vector(text)
    with pytest.raises(InvalidInputError, match=r"line 1: number 22: friction\.constant = inf is no finite number; give one in N m"):
        parse_engine_vector(THESIS.replace("15.1", "1e999"))


def test_the_name_does_not_enter_the_vector() -> None:
    assert format_engine_vector(replace(lee1995(), name="x")).text == format_engine_vector(lee1995()).text


def test_the_vector_in_the_documentation_is_the_thesiss() -> None:
    page = (Path(__file__).parents[2] / "docs" / "engine-files.md").read_text()
    text = page.partition("```text\n")[2].partition("```")[0]
    assert parse_engine_vector(text).content_digest == lee1995().content_digest
