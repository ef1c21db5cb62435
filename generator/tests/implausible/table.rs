//! A recorded flight as a table of numbers that can be changed.

use std::fs;

use dataset::geometry::geodesy::LatLon;
use testkit::repository;

/// A recording as a table that can be changed.
#[derive(Clone)]
pub(crate) struct Table {
    pub(crate) columns: Vec<String>,
    pub(crate) rows: Vec<Vec<f64>>,
}

impl Table {
    pub(crate) fn of(flight: &str) -> Self {
        let path = repository().join(format!("tests/data/flights/{flight}.csv"));
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let columns = lines.next().unwrap().split(',').map(str::to_owned);
        let numbers = |line: &str| {
            line.split(',')
                .map(|field| field.parse().unwrap())
                .collect()
        };
        Self {
            columns: columns.collect(),
            rows: lines.map(numbers).collect(),
        }
    }

    pub(crate) fn place(&self, column: &str) -> usize {
        self.columns.iter().position(|name| name == column).unwrap()
    }

    pub(crate) fn changed(mut self, column: &str, change: impl Fn(f64) -> f64) -> Self {
        let place = self.place(column);
        for row in &mut self.rows {
            row[place] = change(row[place]);
        }
        self
    }

    /// Moves every position by metres towards an azimuth.
    pub(crate) fn moved(mut self, azimuth_deg: f64, metres: f64) -> Self {
        let [latitude, longitude] = [self.place("latitude_deg"), self.place("longitude_deg")];
        for row in &mut self.rows {
            let here = LatLon {
                latitude_deg: row[latitude],
                longitude_deg: row[longitude],
            };
            let there = here.destination(azimuth_deg, metres);
            (row[latitude], row[longitude]) = (there.latitude_deg, there.longitude_deg);
        }
        self
    }

    pub(crate) fn swapped(mut self, one: &str, other: &str) -> Self {
        let [one, other] = [self.place(one), self.place(other)];
        for row in &mut self.rows {
            row.swap(one, other);
        }
        self
    }

    pub(crate) fn text(&self, separator: &str) -> String {
        let mut text = self.columns.join(separator);
        for row in &self.rows {
            let fields: Vec<String> = row.iter().map(f64::to_string).collect();
            text += &format!("\n{}", fields.join(separator));
        }
        text
    }

    /// The table without the rows for which `is_left_out` holds.
    pub(crate) fn without(mut self, is_left_out: impl Fn(usize, &[f64]) -> bool) -> Self {
        let mut row = 0;
        self.rows.retain(|fields| {
            row += 1;
            !is_left_out(row - 1, fields)
        });
        self
    }

    /// The first row past the touchdown target.
    pub(crate) fn passing(&self) -> usize {
        let latitude = self.place("latitude_deg");
        let passed = |row: &Vec<f64>| row[latitude] > 1.3518;
        self.rows.iter().position(passed).unwrap()
    }

    /// Rows that go on from the last one for some seconds, a second each: climbing, or braking on the ground.
    pub(crate) fn continued(mut self, seconds: usize, climbs_mps: f64, brakes_mps2: f64) -> Self {
        let [
            time,
            latitude,
            longitude,
            altitude,
            north,
            east,
            down,
            ground,
            airspeed,
        ] = [
            "t_s",
            "latitude_deg",
            "longitude_deg",
            "altitude_msl_m",
            "v_north_mps",
            "v_east_mps",
            "v_down_mps",
            "on_ground",
            "tas_mps",
        ]
        .map(|column| self.place(column));
        let last = self.rows.len() - 1;
        if climbs_mps > 0.0 {
            self.rows[last][down] = -climbs_mps;
            self.rows[last][ground] = 0.0;
        }
        let azimuth_deg = self.rows[last][east]
            .atan2(self.rows[last][north])
            .to_degrees();
        for _ in 0..seconds {
            let mut row = self.rows[self.rows.len() - 1].clone();
            let before_mps = row[east].hypot(row[north]);
            let speed_mps = (before_mps - brakes_mps2).max(0.0);
            let here = LatLon {
                latitude_deg: row[latitude],
                longitude_deg: row[longitude],
            };
            let there = here.destination(azimuth_deg, (before_mps + speed_mps) / 2.0);
            (row[latitude], row[longitude]) = (there.latitude_deg, there.longitude_deg);
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            (row[north], row[east]) = (speed_mps * cos, speed_mps * sin);
            row[altitude] += climbs_mps;
            row[airspeed] = speed_mps;
            row[time] += 1.0;
            self.rows.push(row);
        }
        self
    }

    /// The flight from the other side: turned by 180 degrees about the touchdown target of WSSS 02L.
    pub(crate) fn turned_around(self) -> Self {
        const TARGET_DEG: [f64; 2] = [1.351_8, 103.978_7];
        self.changed("latitude_deg", |deg| 2.0 * TARGET_DEG[0] - deg)
            .changed("longitude_deg", |deg| 2.0 * TARGET_DEG[1] - deg)
            .changed("v_north_mps", |mps| -mps)
            .changed("v_east_mps", |mps| -mps)
            .changed("heading_true_deg", |deg| (deg + 180.0) % 360.0)
    }
}
