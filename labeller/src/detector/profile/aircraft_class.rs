//! The aircraft among the model's classes: named by the settings, else by the metadata, else the only class, else COCO's airplane.

use std::collections::BTreeMap;
use std::sync::Once;

use crate::error::ModelFault;

/// Names of the class of aircraft in public data sets, the most usual first.
const AIRCRAFT_NAMES: [&str; 4] = ["airplane", "aeroplane", "aircraft", "plane"];
/// Number of `airplane` among the classes of COCO.
const COCO_AIRPLANE: usize = 4;
/// Number of COCO's classes.
const COCO_CLASSES: usize = 80;
/// Maximum number of listed names.
const MAX_LISTED: usize = 12;

fn classes(count: usize) -> String {
    match count {
        1 => "1 class".into(),
        count => format!("{count} classes"),
    }
}

/// The aircraft according to the settings, the metadata's names, and the number of classes in the output, if its shape tells.
pub(crate) fn aircraft_class(
    said: Option<usize>,
    names: Option<&BTreeMap<usize, String>>,
    count: Option<usize>,
) -> Result<usize, ModelFault> {
    let named = names.and_then(|names| Some(names.last_key_value()?.0 + 1));
    if let (Some(named), Some(count)) = (named, count)
        && named != count
    {
        return Err(ModelFault::new(format!(
            "its metadata property names lists {}, but its output has {}: another layout, or a model of another task",
            classes(named),
            classes(count)
        )));
    }
    let count = count.or(named);
    match (said, names, count) {
        (Some(said), _, Some(count)) if said >= count => {
            Err(ModelFault::new(format!(
                "its settings say aircraft_class = {said}, but it has {}, numbered from 0",
                classes(count)
            )))
        }
        (Some(said), ..) => Ok(said),
        (None, _, Some(1)) => Ok(0),
        (None, Some(names), Some(count)) => {
            aircraft_in(names).ok_or_else(|| {
                ModelFault::new(format!(
                    "none of its {} is called {}, but {}; say in its settings which number is the aircraft, e.g. aircraft_class = 4",
                    classes(count),
                    AIRCRAFT_NAMES.join(", "),
                    listed(names)
                ))
            })
        }
        (None, _, Some(COCO_CLASSES)) => Ok(COCO_AIRPLANE),
        (None, _, Some(count)) => Err(ModelFault::new(format!(
            "it has {} and no names for them; say in its settings which number is the aircraft, e.g. aircraft_class = 4",
            classes(count)
        ))),
        (None, _, None) => {
            // Once, not by every worker.
            static WARNED: Once = Once::new();
            WARNED.call_once(|| {
                tracing::warn!(
                    "the model does not say what its classes are: {COCO_AIRPLANE} is taken for the aircraft, as in COCO; if it is \
                     another one, say aircraft_class in the model's settings"
                );
            });
            Ok(COCO_AIRPLANE)
        }
    }
}

/// The first class with the most usual of the names.
fn aircraft_in(names: &BTreeMap<usize, String>) -> Option<usize> {
    let number_of = |wanted: &str| {
        let mut names = names.iter();
        names.find_map(|(number, name)| name.trim().eq_ignore_ascii_case(wanted).then_some(*number))
    };
    AIRCRAFT_NAMES.into_iter().find_map(number_of)
}

fn listed(names: &BTreeMap<usize, String>) -> String {
    let shown = names.iter().take(MAX_LISTED);
    let shown: Vec<_> = shown
        .map(|(number, name)| format!("{number} {name}"))
        .collect();
    let more = if names.len() > MAX_LISTED {
        ", ..."
    } else {
        ""
    };
    shown.join(", ") + more
}

#[cfg(test)]
mod tests {
    use super::*;

    fn aircraft(
        said: Option<usize>,
        names: &[&str],
        count: Option<usize>,
    ) -> Result<usize, ModelFault> {
        let names: BTreeMap<_, _> = names.iter().map(ToString::to_string).enumerate().collect();
        aircraft_class(said, Some(&names).filter(|names| !names.is_empty()), count)
    }

    #[test]
    fn the_aircraft_is_said_or_named_or_the_only_class_or_cocos_airplane() {
        assert_eq!(aircraft(Some(6), &[], Some(7)), Ok(6));
        assert_eq!(aircraft(Some(0), &["bird", "plane"], Some(2)), Ok(0));
        assert_eq!(aircraft(None, &["bird", "Plane"], Some(2)), Ok(1));
        assert_eq!(aircraft(None, &["aircraft", "airplane"], None), Ok(1));
        assert_eq!(aircraft(None, &["A320"], Some(1)), Ok(0));
        assert_eq!(aircraft(None, &["A320"], None), Ok(0));
        assert_eq!(aircraft(None, &[], Some(1)), Ok(0));
        assert_eq!(aircraft(None, &[], Some(80)), Ok(4));
        assert_eq!(aircraft(None, &[], None), Ok(4));
    }

    #[test]
    fn classes_that_contradict_each_other_or_hide_the_aircraft_are_refused_with_both_sides() {
        type Case<'a> = (Option<usize>, &'a [&'a str], Option<usize>, &'a [&'a str]);
        let cases: [Case<'_>; 6] = [
            (Some(6), &[], Some(3), &["aircraft_class = 6", "3 classes"]),
            (Some(1), &["A320"], None, &["aircraft_class = 1", "1 class"]),
            (None, &["a", "b"], Some(80), &["2 classes", "80 classes"]),
            (Some(0), &["a", "b"], Some(54), &["2 classes", "54 classes"]),
            (
                None,
                &["bird", "kite"],
                Some(2),
                &["0 bird, 1 kite", "aircraft_class"],
            ),
            (None, &[], Some(7), &["7 classes", "aircraft_class"]),
        ];
        for (said, names, count, words) in cases {
            let fault = aircraft(said, names, count).unwrap_err().to_string();
            for word in words {
                assert!(fault.contains(word), "{word} in {fault}");
            }
        }
    }
}
