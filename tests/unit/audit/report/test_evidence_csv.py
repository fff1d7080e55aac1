"""The evidence as a table reads back exactly."""

import csv
import dataclasses
import io

import numpy as np

from socialiq.audit.report.evidence_csv import evidence_csv


def test_numbers_read_back_exactly(audited):
    evidence = audited.evidence
    rows = list(csv.DictReader(io.StringIO(evidence_csv(evidence))))
    assert [int(row["seed"]) for row in rows] == evidence.seeds.tolist()
    for driver in (evidence.policy, *evidence.references):
        names = [f"{driver.name}.r_env", f"{driver.name}.r_social"]
        read = np.array([[float(row[name]) for name in names] for row in rows])
        np.testing.assert_array_equal(read, driver.totals)
    assert [int(row["decisions"]) for row in rows] == evidence.policy.length.tolist()
    assert rows[0]["density"] == evidence.strata["density"][0]


def test_no_name_is_a_formula_for_a_spreadsheet(audited):
    first, *others = audited.evidence.references
    named = dataclasses.replace(first, name='=HYPERLINK("x")')
    evidence = dataclasses.replace(audited.evidence, references=(named, *others))
    head = next(csv.reader(io.StringIO(evidence_csv(evidence))))
    assert not any(name.startswith("=") for name in head)
