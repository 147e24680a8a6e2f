"""Which faults a study's config accepts."""

import pytest

from gstlib.errors import (
    FaultError,
    InputError,
    InputsError,
    accepting,
    concerning,
    raise_unless_accepted,
    refuse,
    unaccepted,
)

WHOLE = FaultError("epochs", "t0 and t1", "they are exchanged", "Exchange them.")
OF_TWO = FaultError(
    "placement", "patches", "they lie elsewhere", "Move them.", ("a1", "b2")
)


@pytest.mark.parametrize(
    ("fault", "accepted", "is_accepted"),
    [
        (WHOLE, ["epochs"], True),
        (WHOLE, ["placement", "epochs:a1"], False),
        (OF_TWO, ["placement:a1"], False),
        (OF_TWO, ["placement:b2", "placement:a1"], True),
    ],
)
def test_a_fault_is_accepted_by_its_name_or_for_each_of_its_patches(
    fault, accepted, is_accepted, caplog
):
    assert unaccepted([fault], accepted) == ([] if is_accepted else [fault])
    assert [record.levelname for record in caplog.records] == ["ERROR"] * is_accepted


def test_an_error_that_is_no_judgement_cannot_be_accepted():
    with pytest.raises(InputsError):
        raise_unless_accepted(
            [InputError("mesh", "is missing", "Give it.")], ["mesh", "placement"]
        )


def test_a_fault_deep_within_a_reader_concerns_the_patch_that_is_read():
    fault = FaultError("odd_scan", "a1.plu", "it is damaged", "Export it again.")
    with accepting(["odd_scan:a1"]):
        with concerning(["a1"]):
            refuse(fault)
        fault.patches = ()
        with concerning(["b2"]), pytest.raises(FaultError):
            refuse(fault)
    assert fault.patches == ("b2",)
