//! X-Plane's `apt.dat`: row 1 begins an airport, with the elevation of the field, row 100 is a land runway with both ends.

use std::io::BufRead;

use dataset::numbers::units::METERS_PER_FOOT;

use super::{End, Ends, Facts, Lines, Wanted};

/// Fields of row 100: the first end begins here, and the second.
const ENDS: [usize; 2] = [8, 17];
const DISPLACED_M: std::ops::RangeInclusive<f64> = 0.0..=3_000.0;
/// Elevations of fields, feet.
const ELEVATION_FT: std::ops::RangeInclusive<f64> = -1_500.0..=20_000.0;
const WIDTH_M: std::ops::RangeInclusive<f64> = 1.0..=1_000.0;

pub(super) fn is_one(head: &str) -> bool {
    let mut lines = head.lines();
    matches!(lines.next().map(str::trim), Some("I" | "A"))
        && head
            .lines()
            .any(|line| line.starts_with("1 ") || line.starts_with("100 "))
        || head
            .lines()
            .any(|line| line.split_whitespace().next() == Some("100"))
}

pub(super) fn read<R: BufRead>(
    mut lines: Lines<'_, R>,
    wanted: &Wanted<'_>,
    facts: &mut Facts,
) -> dataset::Result<()> {
    let mut is_here = false;
    while let Some(line) = lines.next()? {
        let fields: Vec<&str> = line.split_whitespace().collect();
        match fields.first() {
            Some(&"1" | &"16" | &"17") => {
                is_here = fields.get(4).is_some_and(|icao| *icao == wanted.airport);
                if is_here {
                    let feet =
                        lines.number("the elevation", fields.get(1).copied(), ELEVATION_FT)?;
                    facts.field_elevation_m = Some(feet * METERS_PER_FOOT);
                }
            }
            Some(&"100") if is_here => {
                let names = ENDS.map(|at| fields.get(at).copied().unwrap_or_default());
                facts.seen.extend(names.map(str::to_owned));
                let Some(near) = names.iter().position(|name| *name == wanted.runway) else {
                    continue;
                };
                let end = |index: usize| -> dataset::Result<End> {
                    let at = ENDS[index];
                    let field = |offset: usize| fields.get(at + offset).copied();
                    Ok(End {
                        name: names[index].to_owned(),
                        place: lines.place(field(1), field(2))?,
                        displaced_m: lines.number(
                            "the displaced threshold",
                            field(3),
                            DISPLACED_M,
                        )?,
                        elevation_m: None,
                    })
                };
                facts.ends.push(Ends {
                    source: "apt.dat",
                    near: end(near)?,
                    far: end(1 - near)?,
                    stated_length_m: None,
                    width_m: Some(lines.number("the width", fields.get(1).copied(), WIDTH_M)?),
                });
            }
            _ => {}
        }
    }
    Ok(())
}
