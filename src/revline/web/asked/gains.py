"""Questions about gains: tuning rules, margins, and the gains that stabilise."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import PidController
from revline.design.regions.gain_curve import Contour, LoopFamily
from revline.design.regions.gain_slices import Question, find_largest_kd, find_slices, mark_controller
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.stability.discrete_loop import find_discrete_margins, sampled_plant_of_model, sampled_plant_of_system
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.design.stability.sampled_margins import find_sampled_margins
from revline.design.tuning.rule_comparison import compare_rules
from revline.design.tuning.rules import tune_by_rule
from revline.design.tuning.tuning_plant import TuningPlant, tuning_plant
from revline.errors import InvalidInputError, out_of_range
from revline.io.margin_records import margin_record
from revline.io.region_records import slices_record
from revline.io.response_files import parse_response
from revline.io.rule_records import comparison_record, loop_record, tuned_record
from revline.io.sampled_margin_records import sampled_margin_record
from revline.web.asked.plants import at_trim, controller_of, model_of, refuse_engine, table_of
from revline.web.asked.responses import PROGRAM
from revline.web.questions import MarginsQuestion, RegionQuestion, TuneQuestion

OF_RULES: Final = (
    ("natural_frequency_rad_s", "natural_frequency"),
    ("damping", "damping"),
    ("closed_loop_lag_s", "closed_loop_lag"),
    ("reading", "reading"),
    ("ultimate_gain", "ultimate_gain"),
    ("ultimate_period_s", "ultimate_period"),
    ("free", "free"),
    ("overshoot_limit", "overshoot_limit"),
    ("objective", "objective"),
    ("horizon_s", "horizon"),
)
"""Keys of a question about tuning, and the options of rules that they are."""


def find_tune_record(asked: TuneQuestion) -> Mapping[str, object]:
    """Answer as `revline tune --json`."""
    options: dict[str, float | str | PidGains] = {option: value for key, option in OF_RULES if (value := getattr(asked, key)) is not None}
    if asked.start is not None:
        options["start"] = controller_of(asked.start, "start").gains
    plant, origin = _tuned(asked)
    if asked.compare:
        if asked.rule is not None or options:
            message = "compare shows every rule with its defaults; leave rule and the rules' options out"
            raise InvalidInputError(message, control="compare")
        return comparison_record(compare_rules(plant), provenance={"program": PROGRAM})
    if asked.rule is None:
        message = 'no rule is given; give the name of one, for example "ziegler-nichols", or compare: true for all'
        raise InvalidInputError(message, control="rule")
    gains = tune_by_rule(asked.rule, plant, options=options)
    return {**tuned_record(gains, provenance={"program": PROGRAM, **origin}), "loop": loop_record(plant, gains)}


def _tuned(asked: TuneQuestion) -> tuple[TuningPlant, dict[str, str]]:
    file = model_of(asked)
    if file is None:
        place = at_trim(asked, asked.throttle_deg)
        return tuning_plant(place.linear, name=place.name), {"engine": place.name}
    refuse_engine(asked)
    return tuning_plant(file.model, name=file.name), {"model": file.name}


def find_margins_record(asked: MarginsQuestion) -> Mapping[str, object]:
    """Answer as `revline margins --json`."""
    file = controller_of(asked.controller)
    if hasattr(file.controller.sampling, "computation_delay"):
        return _discrete(asked, file.controller)
    if asked.csv is not None:
        refuse_engine(asked)
        return _of_response(asked, file.feedback_gains)
    if any(value is not None for value in (asked.unstable_poles, asked.delay_s, asked.columns, asked.amplitude_deg)):
        message = "unstable_poles, delay_s, columns and amplitude_deg are for a frequency response; give csv, or leave them out"
        raise InvalidInputError(message, control="csv")
    model = model_of(asked)
    if model is None:
        place = at_trim(asked, asked.throttle_deg)
        loop = open_loop_of_system(place.linear, file.controller, name=place.name)
    else:
        refuse_engine(asked)
        loop = open_loop_of_model(model.model, file.controller, name=model.name)
    return margin_record(find_margins(loop), file.controller)


def _discrete(asked: MarginsQuestion, controller: PidController) -> Mapping[str, object]:
    """Margins as the samples of a controller see them."""
    if asked.csv is not None:
        message = "a controller that samples needs its plant above half its sampling frequency, which no response shows; give a model"
        raise InvalidInputError(message, control="csv")
    model, speed = model_of(asked), None
    if model is None:
        place = at_trim(asked, asked.throttle_deg)
        plant, speed = sampled_plant_of_system(place.linear, name=place.name), place.trim.output("engine_speed")
    else:
        refuse_engine(asked)
        plant = sampled_plant_of_model(model.model, name=model.name)
    found = find_discrete_margins(plant, controller, speed=speed)
    extra = {"sampling_period_s": found.period, "equivalent_delay_s": found.equivalent_delay, "left_out": found.left_out}
    return {**margin_record(found.margins, controller), **extra}


def _of_response(asked: MarginsQuestion, gains: PidGains) -> Mapping[str, object]:
    table = table_of(asked.csv, None, asked.data_name)
    file = parse_response(table, columns=asked.columns, amplitude=asked.amplitude_deg)
    found = find_sampled_margins(file.response, gains, delay=asked.delay_s, unstable_poles=asked.unstable_poles or 0, name=table.path.stem)
    return sampled_margin_record(found, gains)


def find_region_record(asked: RegionQuestion) -> Mapping[str, object]:
    """Answer as `revline region --json`, without the nonlinear engine."""
    marks = tuple(mark_controller(one.name, controller_of(one.controller, one.name).feedback_gains) for one in asked.mark)
    make, delayed = _families(asked)
    slices = find_slices(make, _region_question(asked, marked=bool(marks)), marks=marks, delayed=delayed)
    return slices_record(slices, largest=find_largest_kd(make) if asked.largest_kd else None)


def _region_question(asked: RegionQuestion, *, marked: bool) -> Question:
    sizes: dict[str, Any] = {key: getattr(asked, key) for key in ("kp_max", "ki_max", "damping", "damping_up_to_rad_s")}
    for key, value in sizes.items():
        if value is not None and not value > 0.0:
            error = out_of_range(key, value, "", "values above 0", "leave it out to have it chosen")
            raise InvalidInputError(str(error), **{**error.details, "control": key})
    return Question(
        kds=tuple(asked.kd) if asked.kd else () if marked else (0.0,),
        peaks=tuple(asked.ms),
        damping=asked.damping or 0.0,
        up_to=asked.damping_up_to_rad_s or 0.0,
        kp_max=asked.kp_max or 0.0,
        ki_max=asked.ki_max or 0.0,
    )


def _families(asked: RegionQuestion) -> tuple[Callable[[float, Contour], LoopFamily], bool]:
    """What makes the plant's families, and whether it has a delay."""
    file = model_of(asked)
    if file is not None:
        refuse_engine(asked)
        model, title = file.model, file.name
        return lambda kd, contour: family_of_model(model, kd=kd, name=title, contour=contour), model.delay > 0.0
    place = at_trim(asked, asked.throttle_deg)
    linear, name = place.linear, place.name
    return lambda kd, contour: family_of_system(linear, kd=kd, name=name, contour=contour), bool(linear.lags.size)
