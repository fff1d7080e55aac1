"""`data trust`: whether labels of demonstrations agree with each other and with their world."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.output import Printing
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.trust import FALSE_ALARMS, Consistency, consistency
from socialiq.errors import UserError
from socialiq.evaluation.labels import recompute
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.plotting import style
from socialiq.results_folder import as_csv
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row

LABELS = ("r_env", "r_social")


@dataclass(frozen=True)
class Trust(Printing):
    """Test the labels of every episode against the other episodes', or trusted ones.

    Example: socialiq data trust mixed.safetensors --reference mine.safetensors --out trust
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    reference: Path | None = None
    """Demonstrations that you trust, of the same world: forged labels show whatever their share.
    Without them most of the file must be honest."""
    out: Path | None = None
    """Folder to make: episodes.csv, trust.json, trust.png, and the episodes that are left,
    kept.safetensors."""

    def run(self) -> int:
        """Judge, print the counts, write the folder."""
        if self.out is not None:
            check_output_folder(self.out)
        data = files.load(self.file, continuous=True)
        reference = None if self.reference is None else files.load(self.reference, continuous=True)
        judged = consistency(data, reference)
        world = recompute(data)
        rows = _rows(data, judged, world.agrees if world.world else None)
        result: Row = {"file": str(self.file), "episodes": data.n_episodes}
        result |= {"flagged": int(judged.flagged.sum()), "false_alarms": FALSE_ALARMS}
        result |= dict(zip(("limit_r_env", "limit_r_social"), judged.limit.tolist(), strict=True))
        result |= {"world": world.world or world.reason}
        result["forged"] = int((~world.agrees).sum()) if world.world else None
        if self.out is not None:
            kept = np.flatnonzero(~judged.flagged & world.agrees)
            if not len(kept):
                raise UserError(f"{self.file}: no episode is left: its labels follow no rule")
            with whole_folder(self.out) as folder:
                write_atomically(folder / "episodes.csv", as_csv(rounded(rows)))
                write_json(folder / "trust.json", rounded(result))
                files.save(folder / "kept.safetensors", data.select(kept))
                figure = {"trust": trust_figure(rows, judged)}
                write_atomically(folder / "trust.png", style.png(figure)["trust"])
        return self.show(result, [{k: v for k, v in result.items() if k != "file"}])


def _rows(
    data: Demonstrations, judged: Consistency, agrees: np.ndarray | None
) -> list[dict[str, Any]]:
    """Return a row for each episode; `agrees` is whether its world has the same labels."""
    names = [data.mode_names[mode] for mode in data.episode_modes]
    rows = []
    for episode, (mode, gaps) in enumerate(zip(names, judged.residual.tolist(), strict=True)):
        row: Row = {"episode": episode, "mode": mode, "steps": int(data.episode_lengths[episode])}
        row |= {f"residual_{label}": gap for label, gap in zip(LABELS, gaps, strict=True)}
        row["flagged"] = bool(judged.flagged[episode])
        rows.append(row | {"forged": "" if agrees is None else not agrees[episode]})
    return rows


def trust_figure(rows: list[Row], judged: Consistency) -> Any:
    """Draw each episode's largest residual of either label, with the limits.

    Args:
        rows: A row for each episode: its number, its residuals, and whether it is flagged.
        judged: Result of `consistency`, for its limits.
    """
    figure = style.figure(9.0, 3.4)
    for axes, label, limit in zip(figure.subplots(1, 2), LABELS, judged.limit, strict=True):
        for flagged, color, name in ((False, "C0", "kept"), (True, "C3", "flagged")):
            chosen = [row for row in rows if row["flagged"] is flagged]
            places = (
                [row["episode"] for row in chosen],
                [row[f"residual_{label}"] for row in chosen],
            )
            axes.plot(*places, "o" if flagged else ".", color=color, label=name)
        axes.axhline(limit, color="#6e6e6e", linestyle="--", label="limit")
        words = {"xlabel": "episode", "ylabel": f"largest gap of {label}"}
        style.finish(axes, "", 9, **words)
    style.head(figure, "How far an episode's labels are from what other episodes say")
    return figure
