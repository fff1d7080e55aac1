"""The JSON Schema of `report.json`; the shipped file is made from here."""

from __future__ import annotations

from typing import Any

from socialiq.audit.commitment import LARGEST_SEED
from socialiq.audit.evidence.outcomes import CRITERIA
from socialiq.audit.profile.fields import SHA256_PATTERN
from socialiq.audit.verdict.shift import MEASURES

Schema = dict[str, Any]

LARGEST = 1e12  # of a number; none of an audit comes near, and pages can be drawn up to it

NUMBER: Schema = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}

TEXT: Schema = {"type": "string"}

FLAG: Schema = {"type": "boolean"}

COUNT: Schema = {"type": "integer", "minimum": 0, "maximum": LARGEST_SEED}

SHARE: Schema = {"type": "number", "minimum": 0, "maximum": 1}

HASH: Schema = {"type": "string", "pattern": SHA256_PATTERN}

SEED: Schema = {"type": "string", "pattern": "^[0-9]{1,20}$"}

DECISION: Schema = {"enum": ["pass", "fail", "inconclusive"]}

FILM = r"^episodes/(median|worst)-[123]\.gif$"

ANYTHING: Schema = {"type": "object"}

REWARDS: Schema = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}


def schema() -> Schema:
    """Content of `report.schema.json` (JSON Schema 2020-12)."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Report of an audit: whether a driving policy behaves as declared",
        "description": "Angles in degrees, rewards per episode. Seeds of episodes are texts, "
        "since they have more than 53 bits.",
        **_table(
            format={"const": 1},
            verdict=_verdict(),
            declaration=_declaration(),
            policy=_table(record=_record(), deterministic=FLAG, means=_driver()),
            tests=_tests(),
            references=_list(_driver(record=_or_null(_record()))) | {"minItems": 1},
            reference_files=_list(TEXT),
            left_out=_list(TEXT),
            strata=_list(_stratum()),
            shift=_or_null(_shift()),
            episodes=_table(median=_list(_episode()), worst=_list(_episode())),
            cloud=_list(REWARDS),
            limits=_list(TEXT),
            seeds=_seeds(),
            hashes=_table(
                **dict.fromkeys(("policy", "profile", "reward", "scenario", "package"), HASH)
            ),
            versions={"type": "object", "additionalProperties": TEXT},
            machine=TEXT,
            timing=_table(started=TEXT, seconds=NUMBER),
            command=TEXT,
        ),
    }


def _table(**properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _record() -> Schema:
    """Common part of a policy's record; its kind adds more."""
    named = dict.fromkeys(("kind", "source", "covers"), TEXT)
    sizes = dict.fromkeys(("n_features", "n_actions"), COUNT)
    return _table(**named, sha256=HASH, **sizes, soft=FLAG) | {"additionalProperties": True}


def _list(of: Schema) -> Schema:
    return {"type": "array", "items": of}


def _or_null(one: Schema) -> Schema:
    return {"anyOf": [one, {"type": "null"}]}


def _verdict() -> Schema:
    return _table(
        decision=DECISION,
        reason=TEXT,
        episodes=COUNT,
        needed=_or_null(COUNT),
        error=SHARE,
        exit_code={"enum": [0, 1, 3]},
    )


def _declaration() -> Schema:
    floor = dict.fromkeys(("max_at_fault", "max_struck", "min_arrival", "max_timeout"), SHARE)
    return _table(
        angle=NUMBER,
        confidence=SHARE,
        owner=TEXT,
        date=TEXT,
        margin=_table(regret=NUMBER, degrees=NUMBER),
        reward=_table(id=TEXT, sha256=HASH),
        scenario=_table(world=TEXT, options=ANYTHING, sha256=HASH),
        competence=_table(**floor),
        sha256=HASH,
    )


def _shares() -> dict[str, Schema]:
    return dict.fromkeys(CRITERIA, SHARE)


def _driver(**more: Schema) -> Schema:
    return _table(
        name=TEXT,
        angles=_list(NUMBER),
        r_env=NUMBER,
        r_social=NUMBER,
        value=NUMBER,
        expected=_or_null(_table(env=NUMBER, social=NUMBER)),
        **_shares(),
        decisions=NUMBER,
        **more,
    )


def _tests() -> Schema:
    return _table(
        regret=_regret(),
        rationalised=_rationalised(),
        alpha_hat=_or_null(_alpha_hat()),
        identifiability=_table(
            env=NUMBER,
            social=NUMBER,
            major=NUMBER,
            minor=NUMBER,
            tilt=NUMBER,
            confidence=SHARE,
            holds_origin=FLAG,
        ),
        calibration=_calibration(),
        competence=_list(_floor_test()),
    )


def _alpha_hat() -> Schema:
    return _table(angle=NUMBER, low=NUMBER, high=NUMBER, env=NUMBER, social=NUMBER)


def _regret() -> Schema:
    return _table(
        decision=DECISION,
        angle=NUMBER,
        margin=NUMBER,
        regret=NUMBER,
        low=NUMBER,
        high=NUMBER,
        pass_error=SHARE,
        fail_error=SHARE,
        best=TEXT,
        references=_list(_table(name=TEXT, regret=NUMBER, high=NUMBER, compared=FLAG)),
        episodes=COUNT,
        needed=_or_null(COUNT),
    )


def _rationalised() -> Schema:
    arcs = _list(_table(low=NUMBER, high=NUMBER))
    return _table(
        arcs=arcs, surely=arcs, possibly=arcs, least_angle=NUMBER, least=NUMBER, margin=NUMBER
    )


def _calibration() -> Schema:
    return _table(
        status={"enum": ["calibrated", "no curve", "beyond the curve", "no direction"]},
        decision=DECISION,
        declared=NUMBER,
        margin=NUMBER,
        nearest=_or_null(REWARDS),
        low=_or_null(NUMBER),
        high=_or_null(NUMBER),
        error=SHARE,
        monotone=FLAG,
        curve=_list(_table(name=TEXT, angle=NUMBER, shown=NUMBER)),
    )


def _floor_test() -> Schema:
    return _table(
        name={"enum": list(CRITERIA)},
        decision=DECISION,
        side={"enum": ["at most", "at least"]},
        limit=SHARE,
        count=COUNT,
        episodes=COUNT,
        share=SHARE,
        low=NUMBER,
        high=NUMBER,
        pass_error=SHARE,
        fail_error=SHARE,
        needed=_or_null(COUNT),
    )


def _stratum() -> Schema:
    return _table(
        stratification=TEXT,
        label=TEXT,
        episodes=COUNT,
        regret=_or_null(_table(mean=NUMBER, low=NUMBER, high=NUMBER, p=_or_null(NUMBER))),
        shares=_table(**dict.fromkeys(CRITERIA, _table(value=SHARE, low=NUMBER, high=NUMBER))),
    )


def _shift() -> Schema:
    change = _table(
        measure={"enum": list(MEASURES)},
        declared=NUMBER,
        there=NUMBER,
        change=NUMBER,
        low=NUMBER,
        high=NUMBER,
        shown=FLAG,
        reference=_or_null(NUMBER),
    )
    traffic = _table(
        name=TEXT,
        options=ANYTHING,
        scenario_sha256=HASH,
        episodes=COUNT,
        decision=DECISION,
        best=TEXT,
        changes=_list(change),
    )
    return _table(sentence=TEXT, otherwise=FLAG, traffic=_list(traffic) | {"minItems": 1})


def _episode() -> Schema:
    return _table(
        episode=COUNT,
        seed=SEED,
        r_env=NUMBER,
        r_social=NUMBER,
        value=NUMBER,
        ending=TEXT,
        decisions=COUNT,
        film=_or_null({"type": "string", "pattern": FILM}),
    )


def _seeds() -> Schema:
    return _table(
        seed=COUNT,
        chosen_by={"enum": ["operating system", "auditor"]},
        episodes=COUNT,
        commitment_sha256=HASH,
        order=TEXT,
    )
