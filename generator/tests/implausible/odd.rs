//! Unusual recordings of good approaches, and good ones in unusual files.

use super::table::Table;

/// Course of WSSS 02L, degrees.
const COURSE_DEG: f64 = 23.02;

/// File texts of sixty kinds.
pub(crate) fn unusual(good: &Table) -> Vec<(String, String)> {
    let mut kinds = files(good);
    let mut add = |kind: String, table: Table| kinds.push((kind, table.text(",")));
    let changed = |column: &str, change: &dyn Fn(f64) -> f64| good.clone().changed(column, change);
    for metres in [-60.0, -40.0, -25.0, 25.0, 40.0, 60.0] {
        let moved = good.clone().moved(COURSE_DEG + 90.0, metres);
        add(format!("{metres} m to the right"), moved);
    }
    for metres in [-5.0, 5.0, 10.0, 15.0] {
        let table = changed("altitude_msl_m", &|m| m + metres);
        add(format!("{metres} m higher"), table);
    }
    for seconds in [-1_000.0, 0.37, 86_390.0, 1.7e9] {
        let table = changed("t_s", &|s| s + seconds);
        add(format!("times that begin at {seconds} s"), table);
    }
    for degrees in [-25.0, -20.0, -10.0, 10.0, 20.0, 25.0] {
        let table = changed("heading_true_deg", &|deg| (deg + degrees + 360.0) % 360.0);
        add(format!("a crab of {degrees} degrees"), table);
    }
    for mps in [-20.0, -15.0, -8.0, 8.0, 15.0] {
        let table = changed("tas_mps", &|tas| (tas + mps).max(0.0));
        add(format!("a headwind of {mps} m/s"), table);
    }
    for (column, value) in [
        ("gear_norm", 1.0),
        ("flap_norm", 1.0),
        ("flap_norm", 0.0),
        ("on_ground", 0.0),
        ("pitch_deg", 2.5),
        ("roll_deg", 0.0),
        ("roll_deg", 0.5),
    ] {
        add(
            format!("{column} is always {value}"),
            changed(column, &|_| value),
        );
    }
    let level = changed("pitch_deg", &|_| 0.0).changed("roll_deg", |_| 0.0);
    add("level wings and nose".into(), level);
    add(
        "a nose 3 degrees higher".into(),
        changed("pitch_deg", &|deg| deg + 3.0),
    );
    let signed = changed("heading_true_deg", &|deg| {
        if deg > 180.0 { deg - 360.0 } else { deg }
    });
    add("headings from -180 to 180".into(), signed);
    let western = changed("heading_true_deg", &|deg| deg - 360.0);
    add("headings from -360 to 0".into(), western);
    let columns = ["v_north_mps", "v_east_mps", "v_down_mps", "tas_mps"];
    let coarse = columns.iter().fold(good.clone(), |table, column| {
        table.changed(column, |value| (value * 10.0).round() / 10.0)
    });
    add("one digit".into(), coarse);
    let centimetres = |value: f64| (value * 1e7).round() / 1e7;
    let coarse = changed("latitude_deg", &centimetres).changed("longitude_deg", centimetres);
    add("positions of a centimetre".into(), coarse);
    for every in [2, 5, 10] {
        let table = good.clone().without(|row, _| row % every != 0);
        add(format!("one row of {every}"), table);
    }
    let irregular = good.clone().without(|row, _| row % 7 == 3 || row % 11 == 5);
    add("rows that are missing here and there".into(), irregular);
    add("rows until it has landed".into(), {
        let mut table = good.clone();
        table.rows.truncate(table.passing() + 2);
        table
    });
    add("rows from 4 NM on".into(), {
        let latitude = good.place("latitude_deg");
        good.clone().without(|_, row| row[latitude] < 1.29)
    });
    add("a fault an hour before".into(), {
        let mut table = good.clone();
        let mut early = table.rows[0].clone();
        early[0] -= 3_600.0;
        early[table.place("pitch_deg")] = 400.0;
        table.rows.insert(0, early);
        table
    });
    add("a landing half an hour before".into(), {
        let mut table = good.clone();
        let later = good.rows.iter().map(|row| {
            let mut row = row.clone();
            row[0] += 1_800.0;
            row
        });
        table.rows.extend(later);
        table
    });
    let parked = good.clone().continued(120, 0.0, 1.5);
    add("two minutes of taxiing after the landing".into(), parked);
    kinds
}

/// The flight as it is in files of other forms.
fn files(good: &Table) -> Vec<(String, String)> {
    let text = good.text(",");
    let (header, rows) = text.split_once('\n').unwrap();
    let quoted: Vec<String> = header
        .split(',')
        .map(|name| format!("\"{name}\""))
        .collect();
    let reversed = |line: &str| line.split(',').rev().collect::<Vec<_>>().join(",");
    let words = |no: &str, yes: &str| {
        format!("{text}\n")
            .replace(",0\n", &format!(",{no}\n"))
            .replace(",1\n", &format!(",{yes}\n"))
    };
    let extra: Vec<String> = rows.lines().map(|line| format!("{line},B738")).collect();
    let exponents = |line: &str| {
        let fields = line.split(',').map(|field| {
            let number: f64 = field.parse().unwrap();
            format!("{number:e}")
        });
        fields.collect::<Vec<_>>().join(",")
    };
    let each =
        |change: &dyn Fn(&str) -> String| rows.lines().map(change).collect::<Vec<_>>().join("\n");
    let kinds = [
        ("as it is", text.clone()),
        ("semicolons", good.text(";")),
        ("tabs", good.text("\t")),
        ("spaces after commas", good.text(", ")),
        ("lines of Windows", text.replace('\n', "\r\n")),
        ("an empty line at the end", format!("{text}\n\n")),
        ("a byte order mark", format!("\u{feff}{text}")),
        ("quoted names", format!("{}\n{rows}", quoted.join(","))),
        (
            "another order of the columns",
            format!("{}\n{}", reversed(header), each(&reversed)),
        ),
        (
            "a column of text",
            format!("{header},type\n{}", extra.join("\n")),
        ),
        ("exponents", format!("{header}\n{}", each(&exponents))),
        ("False and True", words("False", "True")),
        ("FALSE and TRUE", words("FALSE", "TRUE")),
        ("f and t", words("f", "t")),
        ("0.0 and 1.0", words("0.0", "1.0")),
    ];
    kinds.map(|(kind, text)| (kind.to_owned(), text)).into()
}
