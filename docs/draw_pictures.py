"""Draw the pictures of README and documentation from the package itself: `python docs/draw_pictures.py`."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.fitting.model_choice import MODEL_STRUCTURES, fit_structure
from revline.design.loops.closed_loop import LoopTask, run_linear_loop, run_loop
from revline.design.stability.compared_plant import plant_of_model, plant_of_system
from revline.design.stability.nu_gap import judge_controller
from revline.design.tuning.rules import tune_pi_pole_placement
from revline.design.two_inputs.load_steps import LoadStep
from revline.design.two_inputs.mid_ranging import design_mid_ranging
from revline.design.two_inputs.mid_ranging_comparison import PlantCase, compare_mid_ranging
from revline.lti.transfer_function import TransferFunction
from revline.report.mid_ranging import plot_load_steps
from revline.report.nu_gap import plot_nu_gap
from revline.report.style import BLUE, GREY, VERMILION, styled
from revline.studies.config import StudyConfig
from revline.studies.loop_steps import operating_point, throttle_limits
from revline.studies.steps import find_point, table_response

IMAGES = Path(__file__).parent / "images"


def draw_promise_and_engine() -> Figure:
    """Controller C1 on the model that it was designed on, and on the engine."""
    config = StudyConfig()
    engine = config.load_engine()
    point = find_point(engine, config)
    g1 = fit_structure(table_response(), MODEL_STRUCTURES[0]).fit.model
    c1 = tune_pi_pole_placement(g1, natural_frequency=18.85, damping=1.25, designed_on="g1")
    task = LoopTask(command=60.0, until=8.0)
    rest = operating_point(point)
    model = run_linear_loop(g1, c1, task, name="g1", base=(25.0, rest.measurement))
    truth = run_loop(engine, rest, c1, task, limits=throttle_limits(engine))
    with styled():
        figure = Figure(figsize=(9.0, 2.9), layout="constrained")
        promise, fact = figure.subplots(1, 2, sharey=True)
        for axes, run, colour, text in (
            (promise, model, BLUE, "the model without delay promises"),
            (fact, truth, VERMILION, "the engine does"),
        ):
            axes.plot(np.append(-0.2, run.times), np.append(run.start, run.output), color=colour)
            axes.axhline(run.target, color=GREY, linestyle="--", linewidth=0.9)
            axes.set(xlabel="time (s)", xlim=(-0.2, 3.0))
            axes.set_title(text, loc="left", fontsize=10)
        promise.set_ylabel("engine speed (rad/s)")
        promise.annotate("command", (2.95, model.target), xytext=(0, -12), textcoords="offset points", ha="right", color=GREY)
    return figure


def draw_nu_gap() -> Figure:
    """Chords from the thesis's models to the engine, beside the margins of the controllers that were tuned on them."""
    engine = StudyConfig().load_engine()
    exact = plant_of_system(linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model, name=engine.name)
    lag, double = (1.0, 0.57938), (1.0, 0.55159, 0.034396)
    judged = []
    for title, gain, denominator, delay, (kp, ki, kd) in (
        ("C1 on G1", 12.2163, lag, 0.0, (2.153, 16.85, 0.0)),
        ("C2 on G2", 12.0066, double, 0.0, (20.0, 110.0, 0.4)),
        ("C2d on G2d", 12.0066, double, 0.0213, (1.2, 2.0, 0.1)),
    ):
        model = TransferFunction(numerator=(gain,), denominator=denominator, delay=delay, input_unit="deg", output_unit="rad/s")
        gains = PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule=title, designed_on=title)
        judged.append((title, judge_controller(plant_of_model(model, name=title), exact, gains)))
    return plot_nu_gap(judged)


def draw_two_inputs() -> Figure:
    """Spark and throttle at idle after a step of the load, beside the throttle alone."""
    engine = StudyConfig().load_engine()
    trim = find_trim(engine, inputs={"throttle": 12.0, "spark": -20.0})
    plants = (PlantCase("nominal", engine, trim),)
    return plot_load_steps(compare_mid_ranging(design_mid_ranging(engine, trim), plants, LoadStep(size=4.0)))


def main() -> None:
    """Draw all pictures."""
    IMAGES.mkdir(exist_ok=True)
    draw_promise_and_engine().savefig(IMAGES / "c1-promise-and-engine.png", dpi=150, metadata={"Software": None})
    draw_nu_gap().savefig(IMAGES / "nu-gap.png", dpi=150, metadata={"Software": None})
    draw_two_inputs().savefig(IMAGES / "two-inputs.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    main()
