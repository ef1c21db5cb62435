//! Aircraft types: what they are called, how large they are, how fast they approach, and how they look.

use std::sync::LazyLock;

use serde::Deserialize;

use crate::parts::boeing_737_800;
use crate::shape::{LampPlaces, Shape, Size};
use crate::{Configuration, Mesh};

/// The files of `types/`; the type that is drawn by hand comes first.
const FILES: [&str; 8] = [
    include_str!("../types/b738.toml"),
    include_str!("../types/a20n.toml"),
    include_str!("../types/a333.toml"),
    include_str!("../types/md82.toml"),
    include_str!("../types/a359.toml"),
    include_str!("../types/b77w.toml"),
    include_str!("../types/at76.toml"),
    include_str!("../types/c750.toml"),
];

static TYPES: LazyLock<Vec<AircraftType>> = LazyLock::new(|| {
    let parse = |text: &&str| {
        toml::from_str(text)
            .unwrap_or_else(|error| unreachable!("a file of crates/airframe/types: {error}"))
    };
    FILES.iter().map(parse).collect()
});

/// An aircraft type.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct AircraftType {
    /// Name in sweeps, plans and corpora, e.g. `A350-900`.
    pub name: String,
    /// ICAO designator, which sweeps may use instead, e.g. `A359`.
    pub designator: String,
    /// Name with manufacturer.
    pub title: String,
    /// Equivalent airspeed on final without wind, metres per second.
    pub approach_speed_mps: f64,
    /// Sources of the figures.
    pub sources: Vec<String>,
    /// Files of X-Plane's own aircraft of the type.
    #[serde(default)]
    pub x_plane: XPlaneFiles,
    /// Published dimensions, which the mesh has.
    pub published: Published,
    #[serde(flatten)]
    shape: Shape,
}

/// The `.acf` files of a type below X-Plane's folder, by X-Plane's version; absent where it brings none along.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct XPlaneFiles {
    /// In X-Plane 11.
    #[serde(rename = "11")]
    pub in_11: Option<String>,
    /// In X-Plane 12.
    #[serde(rename = "12")]
    pub in_12: Option<String>,
}

impl XPlaneFiles {
    /// All files.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        [&self.in_11, &self.in_12]
            .into_iter()
            .flatten()
            .map(String::as_str)
    }
}

/// Published dimensions of a type.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Wing span with winglets, metres.
    pub span_m: f64,
    /// Overall length, metres.
    pub length_m: f64,
    /// Height of the fin's tip over ground, metres.
    pub height_m: f64,
    /// Largest width of the fuselage, metres.
    pub fuselage_width_m: f64,
}

/// A name that no type has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("aircraft {found:?} is not known, the nearest is {nearest}; known are {known}")]
pub struct UnknownType {
    /// The name.
    pub found: String,
    /// The most similar name of a type.
    pub nearest: String,
    /// Names of all types with their designators.
    pub known: String,
}

impl AircraftType {
    /// All types, in a fixed order.
    pub fn all() -> &'static [Self] {
        &TYPES
    }

    /// The type that is drawn by hand, and that everything flies unless a sweep says otherwise.
    pub fn boeing_737_800() -> &'static Self {
        &TYPES[0]
    }

    /// The type with a name or an ICAO designator.
    ///
    /// # Errors
    /// No type has it.
    pub fn named(name: &str) -> Result<&'static Self, UnknownType> {
        let found = TYPES.iter().find(|of| of.names().contains(&name));
        found.ok_or_else(|| {
            let wanted = name.to_lowercase();
            let likeness = |of: &Self| {
                let each = of
                    .names()
                    .map(|known| strsim::jaro_winkler(&known.to_lowercase(), &wanted));
                each[0].max(each[1])
            };
            let nearest = TYPES
                .iter()
                .max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
            let known: Vec<String> = TYPES
                .iter()
                .map(|of| format!("{} ({})", of.name, of.designator))
                .collect();
            UnknownType {
                found: name.to_owned(),
                nearest: nearest.map_or_else(String::new, |of| of.name.clone()),
                known: known.join(", "),
            }
        })
    }

    /// The mesh in a configuration: closed solids that may intersect, wound counter-clockwise as seen from outside.
    pub fn mesh(&self, configuration: Configuration) -> Mesh {
        if self.is_drawn_by_hand() {
            boeing_737_800(configuration)
        } else {
            self.built_mesh(configuration)
        }
    }

    /// The mesh that the figures make, also for the type that is drawn by hand.
    pub fn built_mesh(&self, configuration: Configuration) -> Mesh {
        self.shape.parts(self.size()).mesh(configuration)
    }

    /// The file by which the stand-in loads the type.
    pub fn stand_in_file(&self) -> String {
        format!("Aircraft/Stand-in/{}.acf", self.designator)
    }

    /// Distance of the lowest point of the extended wheels below the centre of gravity, metres.
    pub fn wheel_height_below_cg_m(&self) -> f64 {
        self.shape.cg_height_m()
    }

    /// Places of the lamps.
    pub fn lamp_places(&self) -> LampPlaces {
        if self.is_drawn_by_hand() {
            return LampPlaces {
                wing_tip: [-4.0, 17.55, -0.8],
                strobe: [-4.2, 17.55, -0.8],
                tail: [-20.0, 0.0, -1.4],
                upper_beacon: [3.0, 0.0, -2.2],
                lower_beacon: [3.0, 0.0, 2.0],
                landing: [3.3, 2.7, 1.0],
                nose_leg: [14.3, 0.0, 1.9],
            };
        }
        self.shape.lamp_places(self.size())
    }

    /// Its name and its designator.
    pub fn names(&self) -> [&str; 2] {
        [&self.name, &self.designator]
    }

    fn is_drawn_by_hand(&self) -> bool {
        self.name == Self::boeing_737_800().name
    }

    fn size(&self) -> Size {
        Size {
            span_m: self.published.span_m,
            height_m: self.published.height_m,
            fuselage_width_m: self.published.fuselage_width_m,
        }
    }
}
