"""The report's section on the engine: its equations, what each symbol means, and its parameters with unit and source."""

from collections.abc import Iterator
from types import MappingProxyType

from revline.engine.air import ThesisEfficiency
from revline.engine.lee1995 import EngineParameters, lee1995_parameters
from revline.report.blocks import Align, Block, Column, Equation, Paragraph, TableBlock
from revline.report.document import Section
from revline.report.inline import Math, Text, marked
from revline.report.numbers import format_number, format_unit
from revline.studies.material import Material, figures
from revline.units import meaning_of, unit_of

SYMBOLS = MappingProxyType(
    {
        "max_flow": '"MAX"', "angle_slope": "c_1", "angle_offset": "c_0", "saturation_angle": 'alpha_"sat"',
        "pressure_exponent": "n_p", "ambient_pressure": 'P_"atm"',
        "volume": "V_m", "temperature": "T_m", "gas_constant": "R",
        "mass_squared_speed": "a_1", "mass_squared": "a_2", "mass_speed": "a_3", "mass": "a_4", "speed": "a_5", "constant": "a_6",
        "line_constant": "b_0", "line_slope": "b_1", "line_origin": "omega_0", "change_speed": "omega_1",
        "parabola_squared": "b_2", "parabola_slope": "b_3",
        "pumping": "K", "angle_per_ratio": "c_A", "best_ratio": "r_A",
        "best_torque_angle": '"MBT"', "exponent": "n_s",
        "intake_to_torque": "theta_1", "spark_to_torque": "theta_2", "torque_constant": "C_T",
        "viscous": "f_1", "inertia": "J_e",
    }
)  # fmt: skip
"""How the equations write each parameter; friction's constant has a name that the volumetric efficiency has too."""

FRICTION_CONSTANT = "f_0"

INTRODUCTION = (
    "The engine is a nonlinear model of two states, the pressure $P_m$ in the intake manifold (kPa) and the engine speed $omega_e$ "
    "(rad/s), with two transport delays. Its inputs are the throttle angle $alpha$ (deg), the air/fuel ratio $A slash F$, the spark "
    "advance $delta$ relative to that of best torque (deg) and the load torque $T_L$ (N m)."
)
AIR = (
    'Air flows through the throttle at the rate $dot(m)_"ai"$ (kg/s): a largest flow times an influence of the pressure ratio, '
    "[](#figure-3.2), and one of the angle, [](#figure-3.3)."
)
FILLING = (
    "The mass $m_a$ in the manifold is that of a perfect gas; the cylinders draw from it with the volumetric efficiency $eta_v$, and what "
    'comes in less what leaves, $dot(m)_"ao"$, fills the manifold.'
)
BURNING = (
    "What the cylinders draw becomes torque $T_i$ (N m) only when the crank has turned by $theta_1$, and the spark acts after $theta_2$. "
    "At the speed $omega_e$ that takes the time $theta_1 slash omega_e$: the delay is long when the engine is slow. The whole charge per "
    "angle in the bracket, the speed in it included, is the one of that earlier time. Mixture and spark scale it, [](#figure-3.4) and "
    "[](#figure-3.5)."
)
TURNING = "What friction $T_f$ and load leave over turns the engine faster."


def engine_section(material: Material) -> Section:
    """Equations, symbols and parameters of the study's engine."""
    parameters = lee1995_parameters(material.engine)
    return Section(title="The engine", anchor="engine", blocks=(*_equations(parameters), *_relations(material), _table(parameters)))


def _equations(parameters: EngineParameters) -> Iterator[Block]:
    yield Paragraph(marked(INTRODUCTION))
    yield Paragraph(marked(AIR))
    yield Equation(source='dot(m)_"ai" = "MAX" cdot "PRI" cdot "TC"', id="2.1")
    yield Equation(source='"PRI" = 1 - exp(n_p (P_m/P_"atm" - 1))', id="2.2")
    yield Equation(source='"TC" = 1 - cos(min(c_1 alpha + c_0, 90 degree))', id="2.3")
    yield Paragraph(marked(FILLING))
    yield Equation(source="m_a = (P_m V_m)/(R T_m)")
    if isinstance(parameters.efficiency, ThesisEfficiency):
        yield Equation(source="eta_v = (a_1 omega_e + a_2) m_a^2 + (a_3 omega_e + a_4) m_a + a_5 omega_e + a_6")
    else:
        yield Equation(source="eta_v = b_0 + b_1 (omega_e - omega_0), omega_e <= omega_1")
        yield Equation(
            source="eta_v = b_0 + b_1 (omega_1 - omega_0) + b_3 (omega_e - omega_1) + b_2 (omega_e^2 - omega_1^2), omega_e > omega_1"
        )
    yield Equation(source='dot(m)_"ao" = K eta_v omega_e m_a', id="2.5")
    yield Equation(source='dot(P)_m = (R T_m)/(V_m) (dot(m)_"ai" - dot(m)_"ao")', id="2.8")
    yield Paragraph(marked(BURNING))
    yield Equation(
        source='T_i (t) = C_T cdot [(dot(m)_"ao" cdot "AFI")/(omega_e)](t - theta_1/(omega_e (t))) cdot "SI"(t - theta_2/(omega_e (t)))',
        id="2.15",
    )
    yield Equation(source='"AFI" = cos(c_A ("A/F" - r_A))')
    yield Equation(source='"SI" = (cos(delta))^(n_s)')
    yield Paragraph(marked(TURNING))
    yield Equation(source="T_f = f_0 + f_1 omega_e", id="2.16")
    yield Equation(source="J_e dot(omega)_e = T_i - T_f - T_L", id="2.17")


def _relations(material: Material) -> tuple[Block, ...]:
    trim = material.results.point.trim
    held = (
        f"The study holds the air/fuel ratio at {trim.input('air_fuel_ratio'):g}, the spark at {trim.input('spark'):g} deg and the "
        f"load at {trim.input('load_torque'):g} N m. Dots in the four figures mark the operating point. "
        "Equations carry their numbers in Lee (1995)."
    )
    return (Paragraph(held), *figures(material, ("3.2", "3.3"), ("3.4", "3.5")))


def _table(parameters: EngineParameters) -> TableBlock:
    columns = (
        Column(heading="Symbol"),
        Column(heading="Parameter"),
        Column(heading="Value", align=Align.RIGHT),
        Column(heading="Unit"),
        Column(heading="Source"),
    )
    return TableBlock(caption="Parameters of the engine", columns=columns, rows=tuple(_rows(parameters)))


def _rows(parameters: EngineParameters) -> Iterator[tuple[Text, ...]]:
    for part_name, part in zip(parameters._fields, parameters, strict=True):
        for name, value in zip(part._fields, part, strict=True):
            symbol = FRICTION_CONSTANT if (part_name, name) == ("friction", "constant") else SYMBOLS[name]
            meaning, unit = meaning_of(type(part), name), unit_of(type(part), name)
            yield (Math(symbol),), meaning.text, format_exactly(value), format_unit(unit), meaning.source


def format_exactly(value: float) -> str:
    """Write a given number with its digits, seven at most, as a table of constants must."""
    return format_number(value, next((digits for digits in range(1, 7) if float(f"{value:.{digits}g}") == value), 7))
