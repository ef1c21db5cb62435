//! `runways.csv` of OurAirports, in the public domain: a row per runway, with both ends.

use std::io::BufRead;
use std::ops::RangeInclusive;

use dataset::numbers::units::METERS_PER_FOOT;

use super::{End, Ends, Facts, Lines, Wanted};

const ELEVATION_FT: RangeInclusive<f64> = -1_500.0..=16_000.0;
const LENGTH_FT: RangeInclusive<f64> = 100.0..=25_000.0;
const WIDTH_FT: RangeInclusive<f64> = 1.0..=3_000.0;
const DISPLACED_FT: RangeInclusive<f64> = 0.0..=10_000.0;

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
        let metres = |what: &str, text: Option<&str>, range| -> dataset::Result<Option<f64>> {
            let feet = text.map(|text| lines.number(what, Some(text), range));
            Ok(feet.transpose()?.map(|feet| feet * METERS_PER_FOOT))
        };
        let end = |index: usize| -> dataset::Result<End> {
            let of = |what: &str| field(&format!("{}_{what}", sides[index]));
            let displaced = of("displaced_threshold_ft");
            Ok(End {
                name: names[index].clone(),
                place: lines.place(of("latitude_deg"), of("longitude_deg"))?,
                displaced_m: metres("the displaced threshold", displaced, DISPLACED_FT)?
                    .unwrap_or(0.0),
                elevation_m: metres("the elevation", of("elevation_ft"), ELEVATION_FT)?,
            })
        };
        facts.ends.push(Ends {
            source: "OurAirports",
            near: end(near)?,
            far: end(1 - near)?,
            stated_length_m: metres("the length", field("length_ft"), LENGTH_FT)?,
            width_m: metres("the width", field("width_ft"), WIDTH_FT)?,
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
