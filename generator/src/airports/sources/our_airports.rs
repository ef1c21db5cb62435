//! `runways.csv` of OurAirports, in the public domain: a row per runway, with both ends.

use std::io::BufRead;

use dataset::numbers::units::METERS_PER_FOOT;

use super::{End, Ends, Facts, Lines, Wanted};

const ELEVATION_FT: std::ops::RangeInclusive<f64> = -1_500.0..=16_000.0;
const LENGTH_FT: std::ops::RangeInclusive<f64> = 100.0..=25_000.0;
const WIDTH_FT: std::ops::RangeInclusive<f64> = 1.0..=3_000.0;
const DISPLACED_FT: std::ops::RangeInclusive<f64> = 0.0..=10_000.0;

pub(super) fn is_one(head: &str) -> bool {
    let header = head.lines().next().unwrap_or_default();
    header.contains("airport_ident") && header.contains("le_latitude_deg")
}

pub(super) fn read<R: BufRead>(
    mut lines: Lines<'_, R>,
    wanted: &Wanted<'_>,
    facts: &mut Facts,
) -> dataset::Result<()> {
    let header = fields(&lines.next()?.unwrap_or_default());
    while let Some(line) = lines.next()? {
        let row = fields(&line);
        let field = |name: &str| {
            let place = header.iter().position(|column| column == name)?;
            row.get(place)
                .map(String::as_str)
                .filter(|text| !text.is_empty())
        };
        let has_ends = ["le_latitude_deg", "he_latitude_deg"]
            .map(field)
            .iter()
            .all(Option::is_some);
        if field("airport_ident") != Some(wanted.airport)
            || !has_ends
            || field("closed") == Some("1")
        {
            continue;
        }
        let sides = ["le", "he"];
        let names = sides.map(|side| {
            field(&format!("{side}_ident"))
                .unwrap_or_default()
                .to_owned()
        });
        facts.seen.extend(names.clone());
        let Some(near) = names.iter().position(|name| name == wanted.runway) else {
            continue;
        };
        let end = |index: usize| -> dataset::Result<End> {
            let of = |what: &str| field(&format!("{}_{what}", sides[index]));
            let feet = |what: &str, column: &str, range| match of(column) {
                Some(text) => lines
                    .number(what, Some(text), range)
                    .map(|feet| Some(feet * METERS_PER_FOOT)),
                None => Ok(None),
            };
            Ok(End {
                name: names[index].clone(),
                place: lines.place(of("latitude_deg"), of("longitude_deg"))?,
                displaced_m: feet(
                    "the displaced threshold",
                    "displaced_threshold_ft",
                    DISPLACED_FT,
                )?
                .unwrap_or(0.0),
                elevation_m: feet("the elevation", "elevation_ft", ELEVATION_FT)?,
            })
        };
        let width_ft = match field("width_ft") {
            Some(text) => Some(lines.number("the width", Some(text), WIDTH_FT)?),
            None => None,
        };
        let length_ft = match field("length_ft") {
            Some(text) => Some(lines.number("the length", Some(text), LENGTH_FT)?),
            None => None,
        };
        facts.ends.push(Ends {
            source: "OurAirports",
            near: end(near)?,
            far: end(1 - near)?,
            stated_length_m: length_ft.map(|feet| feet * METERS_PER_FOOT),
            width_m: width_ft.map(|feet| feet * METERS_PER_FOOT),
        });
    }
    Ok(())
}

fn fields(line: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(line.as_bytes());
    let record = reader.records().next().and_then(Result::ok);
    record.map_or_else(Vec::new, |record| {
        record.iter().map(str::to_owned).collect()
    })
}
