"""Errors of live distances against the labels of a corpus."""

import pyarrow.parquet as parquet

NM_M = 1852


def truth_of(scenario):
    table = parquet.read_table(scenario / "frames.parquet", columns=["time_ns", "dtd_m"]).to_pydict()
    return [(ns * 1e-9, dtd) for ns, dtd in zip(table["time_ns"], table["dtd_m"])]


def true_m(truth, at_s):
    """By a straight line between two ticks."""
    step_s = truth[1][0] - truth[0][0]
    place = (at_s - truth[0][0]) / step_s
    index = int(place)
    if place < 0 or index + 1 >= len(truth):
        return None
    part = place - index
    return truth[index][1] * (1 - part) + truth[index + 1][1] * part


def errors(answers, truth, late_s=0.0):
    found = []
    for at_s, dtd_m in answers:
        expected = true_m(truth, at_s - late_s)
        if expected is not None and NM_M <= expected <= 10 * NM_M:
            found.append(100 * abs(dtd_m / expected - 1))
    return found


def mean(numbers):
    return sum(numbers) / len(numbers) if numbers else None
