//! Tables over all scenarios, with the identifiers in every row.

use dataset::conditions::Weather;
use dataset::corpus::detections::Detection;
use dataset::tables::columns::TableWriter;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use serde_json::Value;

use crate::error::Result;
use crate::scenarios::{FLOWN, LABELLED, Source};

pub(crate) fn scenario_row(source: &Source<'_>) -> TableWriter {
    let record = &source.record;
    let runway = &record.runway;
    let mut table = TableWriter::new()
        .text("scenario", [&record.id])
        .text("trajectory", [&record.trajectory])
        .text("weather", [record.weather_name()])
        .text("time_of_day", [record.time_of_day()]);
    let weather = record.weather();
    let number = |of: fn(&Weather) -> f64| weather.map(of);
    for (name, number) in [
        ("visibility_m", number(|weather| weather.visibility_m)),
        ("rain_ratio", number(|weather| weather.rain_ratio)),
        (
            "turbulence_ratio",
            number(|weather| weather.turbulence_ratio),
        ),
        ("wind_speed_mps", number(|weather| weather.wind_speed_mps)),
        (
            "wind_from_true_deg",
            number(|weather| weather.wind_from_true_deg),
        ),
    ] {
        table = match number {
            Some(number) => table.f64(name, [number]),
            None => table.optional_f64(name, [None]),
        };
    }
    table = table
        .text("aircraft", [&record.aircraft])
        .text("airport", [&runway.airport])
        .text("runway", [&runway.name])
        .f64("course_true_deg", [runway.course_true_deg])
        .f64("glide_path_deg", [runway.glide_path_deg])
        .f64("touchdown_latitude_deg", [record.touchdown.latitude_deg])
        .f64("touchdown_longitude_deg", [record.touchdown.longitude_deg])
        .f64(
            "touchdown_altitude_msl_m",
            [record.touchdown.altitude_msl_m],
        )
        .text("rig", [&record.rig])
        .u32("ticks", [record.ticks])
        .u32("frame_rate_numerator", [record.frame_rate.numerator])
        .u32("frame_rate_denominator", [record.frame_rate.denominator]);
    table = match (record.seed, &record.versions.simulator) {
        (Some(seed), Some(simulator)) => table.u64("seed", [seed]).text("simulator", [simulator]),
        // Recorded: there is neither.
        (_, simulator) => table.optional_text("simulator", [simulator.as_ref()]),
    };
    table
        .text("dtd_version", [&record.versions.dtd])
        .text("config_hash", [&record.config_hash])
        .text("manifest_blake3", [&source.scenario.seal().manifest_blake3])
}

/// The requested views; `video_of` names their files in the export.
pub(crate) fn views(
    source: &Source<'_>,
    video_of: impl Fn(&str) -> Result<String>,
) -> Result<TableWriter> {
    let views = &source.selected.views;
    let mut cameras = Vec::new();
    let mut videos = Vec::new();
    for view in views {
        cameras.push(source.view(view)?.1);
        videos.push(video_of(view)?);
    }
    let mut table = TableWriter::new()
        .text("scenario", views.iter().map(|_| &source.record.id))
        .text("view", views)
        .text("video", videos)
        .u32("width_px", cameras.iter().map(|camera| camera.width_px))
        .u32("height_px", cameras.iter().map(|camera| camera.height_px))
        .f64("focal_px", cameras.iter().map(|camera| camera.k[0][0]))
        .f64("principal_x_px", cameras.iter().map(|c| c.k[0][2]))
        .f64("principal_y_px", cameras.iter().map(|c| c.k[1][2]));
    for (place, name) in ["k1", "k2", "p1", "p2", "k3"].into_iter().enumerate() {
        let coefficients = cameras.iter().map(|c| c.distortion.get(place).copied());
        table = table.optional_f64(name, coefficients);
    }
    table = table.f64(
        "refraction_coefficient",
        cameras.iter().map(|camera| camera.refraction_coefficient),
    );
    for row in 0..3 {
        for column in 0..3 {
            table = table.f64(
                &format!("r{row}{column}"),
                cameras
                    .iter()
                    .map(|c| c.ecef_from_camera.rotation[row][column]),
            );
        }
    }
    for (axis, name) in ["ecef_x_m", "ecef_y_m", "ecef_z_m"].into_iter().enumerate() {
        let places = cameras
            .iter()
            .map(|c| c.ecef_from_camera.translation_m[axis]);
        table = table.f64(name, places);
    }
    Ok(table)
}

/// The requested ticks.
pub(crate) fn ticks(source: &Source<'_>) -> TableWriter {
    let rows: Vec<_> = source.rows().collect();
    let rows = || rows.iter();
    let mut table = TableWriter::new()
        .text("scenario", rows().map(|_| &source.record.id))
        .u32("tick", rows().map(|row| row.tick))
        .i64("time_ns", rows().map(|row| row.time_ns));
    for (name, value) in FLOWN {
        table = table.f64(name, rows().map(|row| value(row)));
    }
    table = table.bool("on_ground", rows().map(|row| row.on_ground));
    for (name, value) in LABELLED {
        table = table.optional_f64(name, rows().map(|row| row.labels.as_ref().map(value)));
    }
    let times_s = rows().map(|row| row.labels.and_then(|labels| labels.time_to_touchdown_s));
    table.optional_f64("time_to_touchdown_s", times_s)
}

/// The ground-truth boxes of the requested images. All scenarios of an export with traffic have the same columns.
pub(crate) fn boxes(source: &Source<'_>, has_traffic: bool) -> Result<TableWriter> {
    let mut boxes = source.scenario.truth_boxes()?;
    boxes.retain(|real| source.has_picture(&real.view, real.tick));
    let boxes = || boxes.iter();
    let sight = |real: &TruthBox| match serde_json::to_value(source.sight_of(real)) {
        Ok(Value::String(word)) => word,
        _ => unreachable!("a sight is a word"),
    };
    let table = TableWriter::new()
        .text("scenario", boxes().map(|_| &source.record.id))
        .text("view", boxes().map(|real| &real.view))
        .u32("tick", boxes().map(|real| real.tick));
    let table = with_boxes(table, || boxes().map(|real| real.pixel_box))
        .f64(
            "visible_fraction",
            boxes().map(|real| real.visible_fraction),
        )
        .f64("truncated_fraction", boxes().map(|real| real.truncation))
        .f64("transmission_ratio", boxes().map(|real| real.transmission))
        .text("sight", boxes().map(sight))
        .bool("is_expected", boxes().map(TruthBox::is_expected));
    if !has_traffic {
        return Ok(table);
    }
    let occluded = boxes().map(|real| real.occluded_fraction.unwrap_or(0.0));
    Ok(table
        .u32("aircraft_number", boxes().map(TruthBox::number))
        .f64("occluded_fraction", occluded))
}

/// The model's detections in the requested images; empty if it did not search the scenario.
pub(crate) fn detections(source: &Source<'_>) -> Result<TableWriter> {
    let Some(model) = &source.model else {
        return Ok(TableWriter::new());
    };
    let mut found = source.scenario.detections(model)?.boxes;
    found.retain(|found| source.has_picture(&found.view, found.tick));
    let found = || found.iter();
    let table = TableWriter::new()
        .text("scenario", found().map(|_| &source.record.id))
        .text("view", found().map(|one| &one.view))
        .u32("tick", found().map(|one| one.tick))
        .text("model", found().map(|_| model));
    let pixel_box = |one: &Detection| one.pixel_box;
    Ok(with_boxes(table, || found().map(pixel_box))
        .f64("score", found().map(|one| one.score))
        .optional_u32("track", found().map(|one| one.track))
        .text("mode", found().map(|one| one.mode.word()))
        .bool("confirmed", found().map(|one| one.confirmed)))
}

fn with_boxes<I: Iterator<Item = PixelBox>>(
    table: TableWriter,
    boxes: impl Fn() -> I,
) -> TableWriter {
    table
        .f64("cx_px", boxes().map(|one| one.cx_px))
        .f64("cy_px", boxes().map(|one| one.cy_px))
        .f64("width_px", boxes().map(|one| one.width_px))
        .f64("height_px", boxes().map(|one| one.height_px))
}
