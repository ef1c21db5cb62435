"""A corpus: its tables over all scenarios, its cameras, its images."""

import warnings
from collections.abc import Collection, Iterable, Iterator
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from dtd.camera import Camera
from dtd.files import CorpusError, collect, damaged, is_sealed, read_json, recorded, refuse_link, scan, sealed, sealed_table
from dtd.video import Picture, Video

_PER_VIEW = ("sim_frame_", "pts_", "echo_", "camera_", "image_time_ns_")
"""Columns of frames.parquet that have one copy for each view begin so and end with the view."""


_SCENARIOS: dict[str, pl.DataType] = {
    **dict.fromkeys(["scenario", "side", "trajectory", "time_of_day", "weather"], pl.String()),
    **dict.fromkeys(["visibility_m", "effective_visibility_m"], pl.Float64()),
    "weather_differs": pl.List(pl.String),
    **dict.fromkeys(["airport", "runway"], pl.String()),
    "frame_rate": pl.Float64(),
    "ticks": pl.Int64(),
    "aircraft": pl.String(),
    "rig": pl.String(),
    "views": pl.List(pl.String),
}
"""Columns of the scenarios, also of a corpus without any."""


class Corpus:
    """A folder that `dtd generate` or `dtd import` made. Every table has a column `scenario`; docs/dataset.md describes the others."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        folders = self.path / "scenarios"
        refuse_link(folders)
        if not folders.is_dir():
            raise CorpusError(f"{self.path} is no corpus: it has no folder scenarios/")
        self._scenarios: dict[str, Path] = {}
        for folder in sorted(folders.iterdir()):
            if folder.suffix == ".partial":
                continue
            if (folder / "DONE.json").exists() or (folder / "DONE.json.new").exists():
                self._scenarios[folder.name] = folder
            elif (folder / "scenario.json").exists():
                warnings.warn(f"{folder} has no DONE.json and is left out; `dtd verify` lists all faults", stacklevel=2)

    def __repr__(self) -> str:
        return f"Corpus({str(self.path)!r}): {len(self._scenarios)} scenarios"

    @property
    def ids(self) -> list[str]:
        """Identifiers of the complete scenarios, sorted."""
        return list(self._scenarios)

    @cached_property
    def _sides(self) -> dict[str, dict[str, str]]:
        path = self.path / "splits.json"
        return dict(read_json(path)["scenarios"]) if path.exists() else {}

    def record(self, scenario: str) -> dict[str, Any]:
        """`scenario.json`: all parameters of a scenario."""
        return dict(read_json(sealed(self._folder(scenario), "scenario.json")))

    def scenarios(self) -> pl.DataFrame:
        """One row per scenario: what it is, and its side of the split.

        `weather_differs` names what the simulator did not report as planned; `dtd train` leaves such scenarios out.
        """
        rows = []
        for scenario in self._scenarios:
            record = self.record(scenario)
            rate, runway = record["frame_rate"], record["runway"]
            # Missing in a scenario that no simulator made.
            conditions = record.get("conditions") or {}
            effective = record.get("effective_weather") or {}
            rows.append(
                {
                    "scenario": scenario,
                    "side": self._sides.get(scenario, {}).get("side"),
                    "trajectory": record["trajectory"],
                    "time_of_day": conditions.get("time_of_day"),
                    "weather": conditions.get("weather_name"),
                    "visibility_m": _number(conditions.get("weather", {}).get("visibility_m")),
                    "effective_visibility_m": _number(effective.get("visibility_m")),
                    "weather_differs": list(effective.get("differing", [])),
                    "airport": runway["airport"],
                    "runway": runway["name"],
                    "frame_rate": rate["numerator"] / rate["denominator"],
                    "ticks": record["ticks"],
                    "aircraft": record["aircraft"],
                    "rig": record["rig"],
                    "views": record["views"],
                }
            )
        return pl.DataFrame(rows, schema=_SCENARIOS)

    def ticks(self) -> pl.DataFrame:
        """One row per scenario and tick: time, pose, and, after `dtd label`, the distance to touchdown."""

        def shared(scenario: str, folder: Path) -> tuple[Path, pl.LazyFrame]:
            path, table, by_view = self._frames(scenario, folder)
            of_views = {name for columns in by_view.values() for name in columns}
            names = [name for name in table.collect_schema().names() if name not in of_views]
            return path, table.select(pl.lit(scenario).alias("scenario"), *names)

        return _together(shared(scenario, folder) for scenario, folder in self._scenarios.items())

    def views(self) -> pl.DataFrame:
        """One row per scenario, tick and view: the image's timestamp, the pose and the camera that the simulator reports.

        Of a recorded scenario: the time of the image, null where the view has none.
        """

        def of_views(scenario: str, folder: Path) -> Iterator[tuple[Path, pl.LazyFrame]]:
            path, table, by_view = self._frames(scenario, folder)
            for view, columns in by_view.items():
                yield path, table.select(
                    pl.lit(scenario).alias("scenario"),
                    pl.lit(view).alias("view"),
                    pl.col("tick"),
                    *(pl.col(name).alias(short) for name, short in columns.items()),
                )

        return _together(table for scenario, folder in self._scenarios.items() for table in of_views(scenario, folder))

    def _frames(self, scenario: str, folder: Path) -> tuple[Path, pl.LazyFrame, dict[str, dict[str, str]]]:
        """frames.parquet of a scenario, and by view its columns with their names without the view."""
        path = sealed_table(folder, "frames.parquet")
        table = scan(path)
        by_view: dict[str, dict[str, str]] = {view: {} for view in self.views_of(scenario)}
        for name in table.collect_schema().names():
            if name.startswith(_PER_VIEW):
                # Of views left and far_left, pts_far_left belongs to the second.
                view = max((view for view in by_view if name.endswith(f"_{view}")), key=len, default=None)
                if view is not None:
                    by_view[view][name] = name.removesuffix(f"_{view}")
        return path, table, by_view

    def boxes(self) -> pl.DataFrame:
        """The ground-truth boxes, after `dtd label`: one row per scenario, tick and view that shows the aircraft.

        Scenarios with traffic have a row per aircraft as well, with its `aircraft_number`, which is 0 or null for the first one.
        """
        name = "boxes_truth.parquet"
        # One that is missing although it is sealed must not pass for a scenario without labels.
        labelled = {scenario: folder for scenario, folder in self._scenarios.items() if is_sealed(folder, name)}
        if not labelled:
            raise CorpusError(f"{self.path} has no ground-truth boxes: run `dtd label` on it first")
        return _with_scenario({scenario: sealed_table(folder, name) for scenario, folder in labelled.items()})

    def aircraft(self) -> pl.DataFrame:
        """All aircraft of scenarios with traffic: one row per scenario, tick and aircraft; empty without traffic."""
        name = "aircraft.parquet"
        busy = {scenario: folder for scenario, folder in self._scenarios.items() if is_sealed(folder, name)}
        return _with_scenario({scenario: sealed_table(folder, name) for scenario, folder in busy.items()})

    def detections(self, model: str | None = None) -> pl.DataFrame:
        """What a detector found, after `dtd detect`. `model`: its file name or the start of its hash, if the corpus has several."""
        return self._of_model("detections", "table_blake3", model)

    def registrations(self, model: str | None = None) -> pl.DataFrame:
        """Where the aircraft of each view is in the first view, after `dtd detect`."""
        return self._of_model("registrations", "registrations_blake3", model)

    def health(self, model: str | None = None) -> pl.DataFrame:
        """The condition of each camera at each tick (`state`, and its direction), after `dtd detect`."""
        return self._of_model("health", "health_blake3", model)

    def backgrounds(self, model: str | None = None) -> pl.DataFrame:
        """The ground that each camera saw in a flight (`png`: grey levels from row `top_px` down), after `dtd detect`."""
        return self._of_model("backgrounds", "backgrounds_blake3", model)

    def predictions(self, run: str | Path) -> pl.DataFrame:
        """What estimators say: one row per scenario, tick and estimator, as in the table `predictions` of an export for Hugging Face.

        `run` is a folder of `dtd evaluate`, whose rows are the judged ticks with their true distance `dtd_m`, or a table of `dtd predict`
        or of other software (Parquet or .csv), as `dtd evaluate --predictions` judges it.
        """
        path = Path(run).resolve()
        name = path.name
        if path.is_dir():
            path = sealed(path, "predictions.parquet")
            if not path.exists():
                raise CorpusError(f"{run} has no predictions: run `dtd evaluate` on it first")
        if not path.exists():
            raise CorpusError(f"{run} is missing; expected a folder of `dtd evaluate`, or a table of `dtd predict`")
        try:
            is_csv = path.suffix.lower() == ".csv"
            if is_csv:
                # All rows give the types: the first may be empty, before the aircraft is in sight.
                table = pl.read_csv(path, schema_overrides={"scenario": pl.String}, infer_schema_length=None, glob=False)
            else:
                table = pl.read_parquet(path, glob=False)
        except (pl.exceptions.PolarsError, OSError) as error:
            raise CorpusError(f"{path} cannot be read: {error}; run `dtd evaluate` or `dtd predict` again") from error
        for column in ("scenario", "tick"):
            if column not in table.columns:
                raise CorpusError(f"{path} is no table of predictions: it has no column {column}, only {', '.join(table.columns)}")
        of_scenario = self.scenarios().select("scenario", "weather", "side")

        def number(column: str, called: str) -> pl.Expr:
            there = pl.col(column) if column in table.columns else pl.lit(None)
            return there.cast(pl.Float64).alias(called)

        def of_estimator(column: str) -> pl.DataFrame:
            return table.select(
                pl.lit(name).alias("run"),
                "scenario",
                pl.col("tick").cast(pl.UInt32),
                pl.lit(column.removesuffix("_dtd_m")).alias("estimator"),
                number(column, "predicted_dtd_m"),
                number(f"{column}_sd", "predicted_dtd_sd_m"),
                number(f"{column}_from", "predicted_dtd_from_m"),
                number(f"{column}_to", "predicted_dtd_to_m"),
                number("dtd_m", "dtd_m"),
                row=pl.int_range(pl.len()),
            )

        estimators = [of_estimator(column) for column in table.columns if column.endswith("_dtd_m")]
        if not estimators:
            raise CorpusError(f"{path} has no predictions: no column is named ESTIMATOR_dtd_m, only {', '.join(table.columns)}")
        rows = pl.concat(estimators).sort("row", maintain_order=True).drop("row")
        return rows.join(of_scenario, on="scenario", how="left", maintain_order="left")

    def views_of(self, scenario: str) -> list[str]:
        """The views of a scenario, in their order."""
        return list(self.record(scenario)["views"])

    def camera(self, scenario: str, view: str) -> Camera:
        """The camera of a view. Each scenario has its own."""
        cameras = read_json(sealed(self._folder(scenario), "calibration.json"))["cameras"]
        _refuse_other_than(cameras, view, f"view of scenario {scenario}")
        return Camera.of_calibration(cameras[view])

    def video(self, scenario: str, view: str) -> Video:
        """The images of a view, to be read in order or by tick."""
        return Video(*self.video_source(scenario, view))

    def video_source(self, scenario: str, view: str) -> tuple[Path, npt.NDArray[np.int64], Fraction, tuple[int, int]]:
        """The file of a view's video, the timestamps of its images, their unit in seconds, and the width and height of its images."""
        folder = self._folder(scenario)
        _refuse_other_than(self.views_of(scenario), view, f"view of scenario {scenario}")
        column = f"pts_{view}"
        table = sealed_table(folder, "frames.parquet")
        (timestamps,) = collect([(table, scan(table).select(column))])
        path = sealed(folder, f"views/{view}.mp4")
        if not path.exists():
            raise CorpusError(f"{folder / 'views'} has no video of view {view}")
        rate, camera = self.record(scenario)["frame_rate"], self.camera(scenario, view)
        size_px = (camera.width_px, camera.height_px)
        return path, timestamps[column].to_numpy(), Fraction(1, rate["numerator"]), size_px

    def frame(self, scenario: str, view: str, tick: int) -> Picture:
        """A single image: height x width x 3, RGB."""
        with self.video(scenario, view) as video:
            return video[tick]

    def frames(self, scenario: str, view: str) -> Iterator[Picture]:
        """All images of a view in order, each decoded once."""
        with self.video(scenario, view) as video:
            yield from video

    def _folder(self, scenario: str) -> Path:
        _refuse_other_than(self._scenarios, scenario, f"complete scenario of {self.path}")
        return self._scenarios[scenario]

    def _of_model(self, folder: str, hash_field: str, model: str | None) -> pl.DataFrame:
        hashes: dict[str, dict[str, str]] = {}
        names: dict[str, str] = {}
        whole: dict[str, str] = {}
        for scenario, place in self._scenarios.items():
            for path in sorted((place / "detections").glob("*.json")):
                record = read_json(path)
                try:
                    if hash_field in record:
                        hashes.setdefault(path.stem, {})[scenario] = record[hash_field]
                        names[path.stem] = record["model"]
                        whole[path.stem] = record["model_blake3"]
                except (KeyError, TypeError) as error:
                    raise damaged(path, f"it is not a record of detections ({error})") from None
        if not hashes:
            raise CorpusError(f"{self.path} has no {folder}: run `dtd detect` on it first")

        def said(stems: Iterable[str]) -> str:
            return ", ".join(f"{names[stem]} ({stem})" for stem in stems)

        chosen = list(hashes)
        if model is not None:
            by_name = [stem for stem in hashes if model in (stem, names[stem], Path(names[stem]).stem)]
            by_hash = [stem for stem in hashes if model and (stem.startswith(model) or whole[stem].startswith(model))]
            chosen = by_name or by_hash
            if not chosen:
                raise CorpusError(f"{self.path} has no {folder} of model {model}, only of {said(hashes)}")
        if len(chosen) > 1:
            which = f"models that {model!r} may mean" if model else "models"
            raise CorpusError(f"{self.path} has {folder} of several {which}; choose one: {said(chosen)}")
        (stem,) = chosen
        return _with_scenario(
            {
                scenario: recorded(self._scenarios[scenario] / folder / f"{stem}.parquet", blake3)
                for scenario, blake3 in hashes[stem].items()
            }
        )


def _number(value: Any) -> float | None:
    """A number of a record that may be missing."""
    return None if value is None else float(value)


def _with_scenario(paths: dict[str, Path]) -> pl.DataFrame:
    """The tables of scenarios as one."""
    return _together((path, scan(path).select(pl.lit(scenario).alias("scenario"), pl.all())) for scenario, path in paths.items())


def _together(tables: Iterable[tuple[Path, pl.LazyFrame]]) -> pl.DataFrame:
    """Scenarios of one corpus may have been labelled or made by different versions: a column that one lacks is null there."""
    parts = collect(tables)
    return pl.concat(parts, how="diagonal_relaxed") if parts else pl.DataFrame()


def _refuse_other_than(choices: Collection[str], name: str, what: str) -> None:
    if name not in choices:
        some = ", ".join(list(choices)[:5])
        raise CorpusError(f"{name!r} is no {what}; there are {len(choices)}: {some}{', ...' if len(choices) > 5 else ''}")
