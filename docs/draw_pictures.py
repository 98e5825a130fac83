"""Draw the pictures of README and documentation from the package itself: `python docs/draw_pictures.py`."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from revline.design.closed_loop import LoopTask, run_linear_loop, run_loop
from revline.design.model_choice import MODEL_STRUCTURES, fit_structure
from revline.design.rules import tune_pi_pole_placement
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


def main() -> None:
    """Draw all pictures."""
    IMAGES.mkdir(exist_ok=True)
    draw_promise_and_engine().savefig(IMAGES / "c1-promise-and-engine.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    main()
