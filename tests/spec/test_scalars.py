"""An unquoted scalar means what it looks like, or is refused with advice."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from bt_dualarm.spec.yaml_reader import ScalarError, plain_value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None), ("~", None), ("null", None),
        ("true", True), ("False", False),
        ("0", 0), ("-12", -12), ("+3", 3),
        ("1e-3", 1e-3), ("1E3", 1000.0), ("-.5", -0.5), ("2.", 2.0), ("1.5e+2", 150.0),
        ("yz", "yz"), ("y", "y"), ("-", "-"), ("1.2.3", "1.2.3"), ("2024-01-01", "2024-01-01"),
        ("1e", "1e"), ("-home", "-home"), ("...", "..."),
    ],
)  # fmt: skip
def test_a_scalar_means_what_it_looks_like(text: str, value: object) -> None:
    assert plain_value(text) == value
    assert type(plain_value(text)) is type(value)


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("yes", 'write true, or "yes" if text is meant'),
        ("No", 'write false, or "No" if text is meant'),
        ("on", 'write true, or "on" if text is meant'),
        ("1:30", 'write 90 if a number is meant, or "1:30" if text is meant'),
        ("-1:30.5", 'write -90.5 if a number is meant, or "-1:30.5" if text is meant'),
        ("0x1F", 'write it in plain decimal digits, or "0x1F" if text is meant'),
        ("0o17", 'write it in plain decimal digits, or "0o17" if text is meant'),
        ("017", 'write it in plain decimal digits, or "017" if text is meant'),
        ("-00", 'write it in plain decimal digits, or "-00" if text is meant'),
        ("1_000", 'write it in plain decimal digits, or "1_000" if text is meant'),
        (".inf", 'or quote it as text: ".inf"'),
        ("-.NaN", 'or quote it as text: "-.NaN"'),
        ("1e999", "it has no finite value"),
        ("9" * 5000, "at most 9007199254740992 is allowed"),
    ],
)
def test_an_ambiguous_scalar_is_refused_with_advice(text: str, advice: str) -> None:
    with pytest.raises(ScalarError) as caught:
        plain_value(text)
    assert caught.value.hint == advice


@given(st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**53), 2**53))
def test_every_number_that_python_writes_is_read_back(number: float) -> None:
    assert plain_value(repr(number)) == number


@given(st.text(alphabet="0123456789.+-eExnatruyslofNY:_~", max_size=8))
@example("-.5")
def test_a_scalar_agrees_with_pyyaml_or_is_refused(text: str) -> None:
    """A value that is accepted as another type than PyYAML's is a date, or a number of YAML 1.2:
    in exponent notation, or with a sign before its point.
    """
    try:
        value = plain_value(text)
    except ScalarError:
        return
    try:
        loader: Any = yaml.SafeLoader("")
        tag = loader.resolve(yaml.ScalarNode, text, (True, False))
        theirs = loader.construct_object(yaml.ScalarNode(tag, text))
    except ValueError:
        return
    if type(value) is not type(theirs):
        assert isinstance(value, (float, str))
        assert isinstance(value, str) or "e" in text.lower() or text[:2] in ("+.", "-.")
    else:
        assert value == theirs
