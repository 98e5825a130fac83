import re

import pytest

from revline.engine.catalogue import ENGINES, build_engine, engine_names
from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, lee1995
from revline.errors import InvalidInputError


def test_the_built_in_engines() -> None:
    assert engine_names() == ("lee1995", "lee1995-generic")
    assert build_engine("lee1995").content_digest == lee1995().content_digest
    assert build_engine("lee1995-generic").parameters == LEE_1995._replace(efficiency=GENERIC_EFFICIENCY)


def test_an_engine_bears_its_catalogue_name() -> None:
    for entry in ENGINES:
        assert build_engine(entry.name).name == entry.name
        assert "\n" not in entry.description
        assert len(entry.description) > 20


def test_an_unknown_engine_is_refused_with_the_nearest_name() -> None:
    message = "there is no built-in engine 'LEE95', did you mean lee1995?; there are lee1995, lee1995-generic"
    with pytest.raises(InvalidInputError, match=f"^{re.escape(message)}$"):
        build_engine("LEE95")
    with pytest.raises(InvalidInputError, match=r"^there is no built-in engine 'v8'; there are lee1995, lee1995-generic$"):
        build_engine("v8")
