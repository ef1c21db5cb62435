//! ONNX metadata properties, written by the program that exported a model.
//!
//! Ultralytics writes `task` (`detect`, `segment`, ...), `names` (the classes, as Python prints a dictionary), `stride` and more;
//! YOLOv5's exporter `names` and `stride`; those of YOLOv7 and YOLOX nothing. A model of this project, or one that its author has
//! edited, may have settings in `dtd_profile`.

use std::collections::BTreeMap;
use std::iter::Peekable;
use std::str::Chars;

/// Name of the metadata property of a model that contains its settings.
pub(super) const METADATA_KEY: &str = "dtd_profile";
/// Task of detection models.
const DETECTION: &str = "detect";
/// Far above the strides of any detector, pixels.
const MAX_STRIDE_PX: u32 = 1_024;

/// The metadata that are used.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct ModelMetadata {
    pub(crate) profile: Option<String>,
    /// Names of the classes by their numbers.
    pub(crate) names: Option<BTreeMap<usize, String>>,
    /// Task, written by Ultralytics.
    pub(crate) task: Option<String>,
    /// Class of the last module, written by Ultralytics: `Detect`, `RTDETRDecoder`, ...
    pub(crate) head: Option<String>,
    /// Divisor of the input's sides, px.
    pub(crate) stride_px: Option<u32>,
}

impl ModelMetadata {
    pub(crate) fn of(property: impl Fn(&str) -> Option<String>) -> Self {
        let names = property("names").and_then(|text| {
            let names = parse_names(&text);
            if names.is_none() {
                tracing::warn!("the model's metadata property names is not understood: {text:?}");
            }
            names
        });
        Self {
            profile: property(METADATA_KEY),
            names,
            task: property("task"),
            head: property("head"),
            stride_px: property("stride")
                .and_then(|text| text.trim().parse().ok())
                .filter(|stride_px| (1..=MAX_STRIDE_PX).contains(stride_px)),
        }
    }

    /// The task, unless it is detection.
    pub(crate) fn other_task(&self) -> Option<&str> {
        self.task.as_deref().filter(|task| *task != DETECTION)
    }

    pub(crate) fn named_classes(&self) -> Option<usize> {
        Some(self.names.as_ref()?.last_key_value()?.0 + 1)
    }

    /// True if Ultralytics exported the model. Such models have no objectness, so rows of six numbers are final boxes.
    pub(crate) fn is_by_ultralytics(&self) -> bool {
        self.task.is_some()
    }
}

/// The names in `{0: 'person', 1: "pilot's seat"}` or `['person', 'seat']`, as Python prints them, or in the same as JSON.
fn parse_names(text: &str) -> Option<BTreeMap<usize, String>> {
    let mut literal = Literal(text.trim().chars().peekable());
    let names = match literal.next()? {
        '{' => literal.items('}', |literal, _| {
            let key = match literal.peek()? {
                '\'' | '"' => literal.string()?,
                _ => literal.digits(),
            };
            literal.expect(':')?;
            Some((key.parse().ok()?, literal.string()?))
        }),
        '[' => literal.items(']', |literal, index| Some((index, literal.string()?))),
        _ => None,
    }?;
    (literal.peek().is_none() && !names.is_empty()).then_some(names)
}

/// A literal of Python or JSON, read from left to right. Spaces between its parts are skipped.
struct Literal<'a>(Peekable<Chars<'a>>);

impl Literal<'_> {
    fn peek(&mut self) -> Option<char> {
        while self.0.next_if(|sign| sign.is_whitespace()).is_some() {}
        self.0.peek().copied()
    }

    fn next(&mut self) -> Option<char> {
        self.peek()?;
        self.0.next()
    }

    fn expect(&mut self, sign: char) -> Option<()> {
        (self.next()? == sign).then_some(())
    }

    /// Items up to the closing bracket, which may follow a comma.
    fn items(
        &mut self,
        closing: char,
        item: impl Fn(&mut Self, usize) -> Option<(usize, String)>,
    ) -> Option<BTreeMap<usize, String>> {
        let mut found = BTreeMap::new();
        while self.peek()? != closing {
            let (key, name) = item(self, found.len())?;
            found.insert(key, name);
            if self.peek()? != closing {
                self.expect(',')?;
            }
        }
        self.next()?;
        Some(found)
    }

    fn digits(&mut self) -> String {
        let mut digits = String::new();
        while let Some(digit) = self.0.next_if(char::is_ascii_digit) {
            digits.push(digit);
        }
        digits
    }

    fn string(&mut self) -> Option<String> {
        let quote = self.next().filter(|sign| matches!(sign, '\'' | '"'))?;
        let mut text = String::new();
        loop {
            match self.0.next()? {
                '\\' => text.push(self.0.next()?),
                sign if sign == quote => return Some(text),
                sign => text.push(sign),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Option<Vec<(usize, String)>> {
        parse_names(text).map(|names| names.into_iter().collect())
    }

    #[test]
    fn names_are_read_as_python_or_json_writes_them() {
        let expected = [(0, "person"), (4, "pilot's seat"), (5, "say \"plane\"")];
        let expected: Vec<_> = expected.map(|(key, name)| (key, name.to_owned())).into();
        for text in [
            r#"{0: 'person', 4: "pilot's seat", 5: 'say "plane"'}"#,
            r#"{"0": "person", "4": "pilot's seat", "5": "say \"plane\""}"#,
            " {5:'say \"plane\"',4:'pilot\\'s seat',\n0:'person',} ",
        ] {
            assert_eq!(names(text).as_ref(), Some(&expected), "{text}");
        }
        let listed = names("['bird', \"kite\"]").unwrap();
        assert_eq!(listed, [(0, "bird".into()), (1, "kite".into())]);
    }

    #[test]
    fn what_is_no_list_of_names_is_none_at_every_length() {
        let text = r#"{0: 'person', 4: "pilot's seat"}"#;
        for end in 0..text.len() {
            assert_eq!(names(&text[..end]), None, "{}", &text[..end]);
        }
        for text in [
            "{}",
            "[]",
            "{0: 1}",
            "{a: 'b'}",
            "{-1: 'b'}",
            "person",
            "['a'] x",
            "['a' 'b']",
        ] {
            assert_eq!(names(text), None, "{text}");
        }
    }
}
