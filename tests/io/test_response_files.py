import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.io.response_files import read_response, write_response
from revline.lti.response import FrequencyResponse

TABLE = Path(__file__).parents[1] / "reference" / "table_4_1.csv"
SOME = FrequencyResponse(omega=np.array([1.0, 2.0]), values=np.array([3.0 - 4.0j, -1.0j]), output_unit="rad/s")


def write(folder: Path, content: str) -> Path:
    path = folder / "response.csv"
    path.write_text(content)
    return path


@pytest.mark.reference
def test_table_4_1_is_read_with_a_lag_as_negative_phase() -> None:
    """Lee (1995), Table 4.1: output amplitudes for 5 deg of throttle."""
    found = read_response(TABLE)
    assert found.response.omega.size == 42
    assert found.response.magnitude[0] == pytest.approx(60.10 / 5.0)
    assert found.response.phase_deg[[0, -1]] == pytest.approx([-0.3, -293.8])
    assert (found.response.input_unit, found.response.output_unit, found.input_amplitude) == ("deg", "rad/s", 5.0)
    assert found.notes == (f"{TABLE} does not give the input amplitude: 5 deg assumed",)
    assert found.distortion.size == 0


def test_the_other_reading_of_the_table_is_chosen_by_name() -> None:
    printed = read_response(TABLE, columns={"amplitude_rad_s": "speed_amplitude_as_printed_rad_s"}, amplitude=5.0)
    right = read_response(TABLE, amplitude=5.0)
    assert printed.notes == ()
    assert np.flatnonzero(printed.response.values != right.response.values).tolist() == [28]
    assert printed.response.magnitude[28] == pytest.approx(19.38 / 5.0)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("frequency_rad_s,magnitude,phase_deg", "6.283185307179586,2,-90"),
        ("omega_rad_s,gain,phase_rad", "6.283185307179586,2,-1.5707963267948966"),
        ("frequency_hz,magnitude_db,phase_lag_deg", "1,6.020599913279624,90"),
        ("frequency_hz;gain_db;phase_lag_rad", "1;6.020599913279624;1.5707963267948966"),
        ("phase_deg\tamplitude_rad_s\tother\tfrequency_rad_s", "-90\t10\t7\t6.283185307179586"),
        ("frequency_hz,speed_amplitude_rad_s,phase_deg", "1,10,-90"),
    ],
)
def test_every_unit_means_the_same(tmp_path: Path, header: str, row: str) -> None:
    found = read_response(write(tmp_path, f"{header}\n{row}\n")).response
    assert found.omega == pytest.approx([2.0 * np.pi])
    assert found.values == pytest.approx([-2.0j])


def test_a_foreign_file_is_read_by_naming_its_columns(tmp_path: Path) -> None:
    path = write(tmp_path, "f,H,arg\n1,2,90\n2,1,100\n")
    found = read_response(path, columns={"frequency_hz": "f", "magnitude": "H", "phase_lag_deg": "arg"}, amplitude=3.0)
    assert found.response.values[0] == pytest.approx(-2.0j)
    assert found.notes == (f"{path} gives ratios: the input amplitude of 3 was not needed",)


@pytest.mark.parametrize("line", ["# input_amplitude_deg = 2", "# input_amplitude: 2"])
def test_the_input_amplitude_of_the_file_counts_unless_another_is_asked_for(tmp_path: Path, line: str) -> None:
    path = write(tmp_path, f"{line}\nfrequency_rad_s,amplitude_rad_s,phase_deg,distortion\n1,12,-10,0.01\n")
    found = read_response(path)
    assert found.response.magnitude == pytest.approx([6.0])
    assert (found.input_amplitude, found.notes, found.distortion.tolist()) == (2.0, (), [0.01])
    asked = read_response(path, amplitude=4.0)
    assert asked.response.magnitude == pytest.approx([3.0])
    assert asked.notes == (f"{path} says that the input amplitude is 2; 4 was used as asked",)


def test_a_phase_whose_turns_the_grid_cannot_show_is_noted(tmp_path: Path) -> None:
    found = read_response(write(tmp_path, "frequency_rad_s,magnitude,phase_deg\n1,1,-10\n100,1,-295\n"))
    assert found.notes == (
        "the phase in the file and the phase unwrapped from the lowest frequency differ by full turns from 100 rad/s on",
    )
    assert read_response(write(tmp_path, "# known_delay_s: 0.02\nfrequency_rad_s,magnitude,phase_deg\n1,1,-10\n100,1,-285\n")).notes == ()


finite = st.floats(-1e150, 1e150)


@given(
    st.lists(st.tuples(st.floats(1e-6, 1e6), finite, finite, st.floats(0.0, 1.0)), min_size=1, max_size=8, unique_by=lambda row: row[0]),
    st.floats(1e-3, 1e3),
    st.floats(0.0, 1.0),
    st.sampled_from(["rad/s", "N m"]),
    st.text(st.characters(categories=["L", "N", "P", "S"]), max_size=10),
)
@settings(deadline=None, max_examples=100)
def test_writing_then_reading_gives_the_same_bits(
    rows: list[tuple[float, float, float, float]], amplitude: float, delay: float, unit: str, method: str
) -> None:
    omega, real, imag, distortion = (np.array(column) for column in zip(*sorted(rows), strict=True))
    values = np.empty(omega.size, dtype=complex)
    values.real, values.imag = real, imag
    response = FrequencyResponse(
        omega=omega, values=values, input_unit="deg", output_name="speed", output_unit=unit, method=method, known_delay=delay
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "response.csv"
        write_response(path, response, amplitude=amplitude, distortion=distortion)
        found = read_response(path)
        first = path.read_bytes()
        write_response(path, found.response, amplitude=found.input_amplitude, distortion=found.distortion)
        assert path.read_bytes() == first
    assert found.response.omega.tobytes() == omega.tobytes()
    assert found.response.values.tobytes() == values.tobytes()
    assert found.distortion.tobytes() == distortion.tobytes()
    assert (found.response.output_unit, found.response.method, found.response.known_delay) == (unit, method, delay)
    assert (found.response.input_name, found.response.output_name, found.input_amplitude) == ("input", "speed", amplitude)


def test_frequencies_that_agree_to_rounding_are_read_without_a_slope_between_them(tmp_path: Path) -> None:
    path, top = tmp_path / "response.csv", 999999.0
    omega = np.array([1.0, 2.0, 3.0, top, np.nextafter(top, np.inf)])
    assert np.log(omega[-1]) == np.log(omega[-2])
    write_response(path, FrequencyResponse(omega=omega, values=np.ones(5, dtype=complex)), amplitude=1.0)
    assert read_response(path).response.omega.tobytes() == omega.tobytes()


def test_turns_that_are_known_are_kept_where_the_grid_cannot_show_them(tmp_path: Path) -> None:
    path, omega = tmp_path / "response.csv", np.array([100.0, 900.0])
    response = FrequencyResponse(omega=omega, values=np.exp(-0.1j * omega), turns=np.array([-2, -14]))
    assert response.phase_deg == pytest.approx(np.degrees(-0.1 * omega))
    write_response(path, response, amplitude=1.0)
    found = read_response(path)
    assert found.response.phase_deg.tolist() == response.phase_deg.tolist()
    assert found.notes == ()
    path.write_text(path.read_text().replace("# phase_turns: counted\n", ""))
    assert read_response(path).response.phase_deg[0] == pytest.approx(np.degrees(-10.0) + 720.0)


def test_what_is_written_names_its_units(tmp_path: Path) -> None:
    path = tmp_path / "response.csv"
    write_response(path, SOME, amplitude=2.0)
    lines = path.read_text().splitlines()
    assert lines[-3:] == [
        "frequency_rad_s,amplitude_rad_s,phase_deg,gain_real,gain_imag",
        "1.0,10.0,-53.13010235415598,3.0,-4.0",
        "2.0,2.0,-90.0,-0.0,-1.0",
    ]
    assert "# input_amplitude: 2.0" in lines


def test_columns_out_of_step_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "response.csv"
    write_response(path, SOME, amplitude=2.0)
    path.write_text(path.read_text().replace("1.0,10.0,", "1.0,11.0,"))
    with pytest.raises(InvalidInputError, match=r"line 9, column gain_real, gain_imag: 3-4j contradicts magnitude and phase"):
        read_response(path)
    chosen = read_response(path, columns={"amplitude_rad_s": "amplitude_rad_s"})
    assert chosen.response.magnitude[0] == pytest.approx(5.5)


HEADER = "frequency_rad_s,magnitude,phase_deg"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (f"{HEADER}\n2,1,0\n1,1,0\n", "line 3, column frequency_rad_s: the frequency is below that of line 2; sort"),
        (f"{HEADER}\n2,1,0\n\n2,1,0\n", "line 4, column frequency_rad_s: the frequency repeats that of line 2"),
        (f"{HEADER}\n0,1,0\n", "line 2, column frequency_rad_s: frequency 0 is not positive"),
        (f"{HEADER}\n-1,1,0\n", "line 2, column frequency_rad_s: frequency -1 is not positive"),
        (f"{HEADER}\n1,-1,0\n", "line 2, column magnitude: -1 is no magnitude"),
        ("frequency_rad_s,magnitude_db,phase_deg\n1,1e5,0\n", "line 2, column magnitude_db: 1e5 is no magnitude"),
        (f"{HEADER}\n1,nan,0\n", "line 2, column magnitude: 'nan' is no finite number"),
        (f"{HEADER}\n1,1,west\n", "line 2, column phase_deg: 'west' is no finite number"),
        ("magnitude,phase_deg\n1,0\n", "line 1: no frequency column among magnitude, phase_deg; name one frequency_rad_s, omega_rad_s"),
        ("frequency_rad_s,phase_deg\n1,0\n", "line 1: no magnitude column among"),
        ("frequency_rad_s,gain\n1,0\n", "line 1: no phase column among"),
        ("frequency_rad_s,gain,gain_db,phase_deg\n1,1,0,0\n", "line 1: gain and gain_db both give the magnitude; say which to use"),
        ("frequency_rad_s,frequency_hz,gain,phase_deg\n1,1,1,0\n", "frequency_rad_s and frequency_hz both give the frequency"),
        ("frequency_rad_s,gain,phase_deg,phase_deg\n1,1,0,0\n", "line 1: 2 columns are named phase_deg"),
        ("# input_amplitude: much\nfrequency_rad_s,amplitude_rad_s,phase_deg\n1,1,0\n", "input_amplitude = 'much' is no number"),
        ("# input_amplitude: 0\nfrequency_rad_s,amplitude_rad_s,phase_deg\n1,1,0\n", "amplitude = 0 deg is outside above 0 and finite"),
        (f"# known_delay_s: late\n{HEADER}\n1,1,0\n", "known_delay_s = 'late' is no number"),
        (f"# known_delay_s: -1\n{HEADER}\n1,1,0\n", "delay = -1 s is outside"),
    ],
)
def test_bad_files_are_refused_with_line_and_column(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        read_response(write(tmp_path, content))


def test_bad_choices_of_columns_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="speed is no quantity of a frequency response; name one of frequency_rad_s"):
        read_response(TABLE, columns={"speed": "frequency_rad_s"})
    with pytest.raises(InvalidInputError, match="there is no column lag; the columns are frequency_rad_s"):
        read_response(TABLE, columns={"phase_lag_deg": "lag"})
    with pytest.raises(InvalidInputError, match="amplitude = nan deg is outside"):
        read_response(TABLE, amplitude=np.nan)


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "response.csv"
    with pytest.raises(InvalidInputError, match="amplitude = -5 is outside above 0"):
        write_response(path, SOME, amplitude=-5.0)
    with pytest.raises(InvalidInputError, match="1 distortions for 2 frequencies"):
        write_response(path, SOME, amplitude=5.0, distortion=np.zeros(1))
    with pytest.raises(InvalidInputError, match=r"method = 'a\\nb' holds a line end"):
        write_response(path, FrequencyResponse(omega=np.ones(1), values=np.ones(1, dtype=complex), method="a\nb"), amplitude=5.0)
    with pytest.raises(InvalidInputError, match="a frequency of 0 or a magnitude of up to 1"):
        write_response(path, FrequencyResponse(omega=np.zeros(1), values=np.ones(1, dtype=complex)), amplitude=5.0)
    with pytest.raises(InvalidInputError, match="a magnitude of up to inf"):
        write_response(path, FrequencyResponse(omega=np.ones(1), values=np.full(1, 1e308 + 0j), output_unit="rad/s"), amplitude=5.0)
    with pytest.raises(
        InvalidInputError, match=r"frequency response .* cannot be written: its folder .*absent does not exist; make it first"
    ):
        write_response(tmp_path / "absent" / "response.csv", SOME, amplitude=5.0)
    assert not path.exists()


OMEGA = np.geomspace(0.1, 60.0, 30)
LAG = 12.0 * np.exp(-0.02j * OMEGA) / (1.0 + 0.55j * OMEGA + 0.034 * (1j * OMEGA) ** 2)


def notes_of(path: Path, header: str, phases: list[float]) -> tuple[str, ...]:
    rows = zip(OMEGA, np.abs(LAG), phases, strict=True)
    path.write_text(f"frequency_rad_s,magnitude,{header}\n" + "".join(f"{w},{m},{p}\n" for w, m, p in rows))
    return read_response(path).notes


def test_a_phase_of_the_wrong_sign_or_unit_is_noted(tmp_path: Path) -> None:
    """A lag written as a positive number, or in radians, under a header that says phase_deg; and, as controls, both rightly named."""
    phase, path = np.unwrap(np.angle(LAG)), tmp_path / "bench.csv"
    for header, column in (("phase_deg", np.degrees(phase)), ("phase_rad", phase), ("phase_lag_deg", -np.degrees(phase))):
        assert notes_of(path, header, column.tolist()) == ()
    for wrong in (-np.degrees(phase), phase):
        (note,) = notes_of(path, "phase_deg", wrong.tolist())
        assert "what the slope of the magnitude allows a stable system" in note
        assert "name it phase_lag_deg, and if it holds radians phase_rad" in note
