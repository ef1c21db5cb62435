//! TOML files that people write. A mistake is reported with file, line and column, followed by the line with the mistake underlined,
//! whether it is one of syntax or a value that a check rejects.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use annotate_snippets::renderer::DecorStyle;
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longer lines are cut around the mistake.
const COLUMNS: usize = 140;

/// Text of the TOML file.
#[derive(Debug, Clone, Copy)]
pub struct TomlFile<'a> {
    path: &'a Path,
    text: &'a str,
}

impl<'a> TomlFile<'a> {
    /// `path` is the name of the file in messages.
    pub fn new(path: &'a Path, text: &'a str) -> Self {
        Self { path, text }
    }

    /// Reads the text as a value.
    ///
    /// # Errors
    /// Invalid syntax, unknown or missing keys, values with a wrong type.
    pub fn parse<T: DeserializeOwned>(self) -> Result<T, TomlError> {
        toml::from_str(self.text).map_err(|error| {
            let span = error.span();
            let message = match span.clone().filter(|span| self.is_datetime(span)) {
                Some(span) => format!(
                    "a time or date without quotes; put it in quotes: \"{}\"",
                    &self.text[span]
                ),
                None => in_words_of_toml(error.message()),
            };
            self.error_at(span, &message)
        })
    }

    /// True if the span holds a TOML date or time, which none of our files have.
    fn is_datetime(self, span: &Range<usize>) -> bool {
        fn is_within(value: &Spanned<DeValue<'_>>, span: &Range<usize>) -> bool {
            match value.get_ref() {
                DeValue::Datetime(_) => value.span() == *span,
                DeValue::Array(items) => items.iter().any(|item| is_within(item, span)),
                DeValue::Table(table) => table.values().any(|item| is_within(item, span)),
                _ => false,
            }
        }
        DeTable::parse(self.text)
            .is_ok_and(|root| root.get_ref().values().any(|value| is_within(value, span)))
    }

    /// The error for a value that was parsed, but that a check rejects. A key such as `grid.times.2` names it; if it is not in the file,
    /// the error points to the nearest table around it.
    pub fn rejected(self, dotted_key: &str, message: &str) -> TomlError {
        self.error_at(span_of(self.text, dotted_key), message)
    }

    fn error_at(self, span: Option<Range<usize>>, message: &str) -> TomlError {
        let mistake = span.and_then(|span| Mistake::in_text(self.text, span));
        TomlError {
            path: self.path.to_owned(),
            place: mistake.as_ref().map(|mistake| mistake.place()),
            message: message.trim().replace('\n', "; "),
            excerpt: mistake.map(|mistake| mistake.excerpt()),
        }
    }
}

/// The parser's message without the names of Rust's types, which are Greek to the authors of files.
fn in_words_of_toml(message: &str) -> String {
    const WORDS: [(&str, &str); 5] = [
        ("u64", "a whole number from 0"),
        ("u32", "a whole number from 0"),
        ("usize", "a whole number from 0"),
        ("f64", "a number"),
        ("f32", "a number"),
    ];
    let words = WORDS.iter().find_map(|(name, words)| {
        let found = message.strip_suffix(name)?.strip_suffix("expected ")?;
        Some(format!("{found}expected {words}"))
    });
    words.unwrap_or_else(|| message.to_owned())
}

/// A mistake in a TOML file. It prints as `scenarios.toml:12:9: found and expected values`, followed by the underlined line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct TomlError {
    /// The file.
    pub path: PathBuf,
    /// Line and column, from 1, if the mistake has a position in the file.
    pub place: Option<(usize, usize)>,
    /// Finding, expectation and remedy.
    pub message: String,
    excerpt: Option<String>,
}

impl fmt::Display for TomlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some((line, column)) = self.place {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {}", self.message)?;
        self.excerpt
            .as_ref()
            .map_or(Ok(()), |excerpt| write!(f, "\n{excerpt}"))
    }
}

/// The part of the line to underline.
struct Mistake<'a> {
    /// Number of the line, from 1.
    number: usize,
    line: &'a str,
    /// Bytes of the line.
    span: Range<usize>,
}

impl<'a> Mistake<'a> {
    /// If a span has several lines, such as a whole table, the first line counts.
    fn in_text(text: &'a str, span: Range<usize>) -> Option<Self> {
        let (before, after) = text.split_at_checked(span.start)?;
        let begin = before.rfind('\n').map_or(0, |newline| newline + 1);
        let rest = after.find('\n').unwrap_or(after.len());
        let line = text[begin..span.start + rest].trim_end_matches('\r');
        let start = (span.start - begin).min(line.len());
        let end = (span.end.max(span.start) - begin).min(line.len());
        Some(Self {
            number: before.matches('\n').count() + 1,
            line,
            span: start..end,
        })
    }

    fn place(&self) -> (usize, usize) {
        let before = &self.line[..self.span.start];
        (self.number, before.chars().count() + 1)
    }

    fn excerpt(&self) -> String {
        let snippet = Snippet::source(self.line)
            .line_start(self.number)
            .annotation(AnnotationKind::Primary.span(self.span.clone()));
        Renderer::plain()
            .decor_style(DecorStyle::Ascii)
            .term_width(COLUMNS)
            .render(&[Group::with_level(Level::ERROR).element(snippet)])
    }
}

/// The position of the value at a dotted key, or of the nearest existing table around it.
fn span_of(text: &str, dotted_key: &str) -> Option<Range<usize>> {
    let root = DeTable::parse(text).ok()?;
    let mut steps = dotted_key.split('.');
    let (key, mut value) = root.get_ref().get_key_value(steps.next()?)?;
    let mut span = match value.get_ref() {
        DeValue::Table(_) | DeValue::Array(_) => key.span(),
        _ => value.span(),
    };
    for step in steps {
        let Some((place, next)) = child(value, step) else {
            break;
        };
        span = place;
        value = next;
    }
    Some(span)
}

type Child<'a, 'i> = (Range<usize>, &'a Spanned<DeValue<'i>>);

fn child<'a, 'i>(value: &'a Spanned<DeValue<'i>>, step: &str) -> Option<Child<'a, 'i>> {
    match value.get_ref() {
        DeValue::Table(table) => {
            let (key, next) = table.get_key_value(step)?;
            // A scalar is located at its value, a table at its name.
            let place = if next.get_ref().is_table() {
                key.span()
            } else {
                next.span()
            };
            Some((place, next))
        }
        DeValue::Array(items) => {
            let next = items.get(step.parse::<usize>().ok()?)?;
            Some((next.span(), next))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    const TEXT: &str =
        "[grid]\ntimes = [\"06:00\", \"25:00\"]\n[weather.foggy]\nvisibility_m = -1\n";

    #[derive(Debug, Deserialize)]
    struct Crew {
        #[allow(dead_code, reason = "only read from text")]
        names: Vec<String>,
    }

    fn found(key: &str) -> &str {
        &TEXT[span_of(TEXT, key).unwrap()]
    }

    fn parse(text: &str) -> TomlError {
        TomlFile::new(Path::new("crew.toml"), text)
            .parse::<Crew>()
            .unwrap_err()
    }

    #[test]
    fn values_items_and_tables_are_found() {
        assert_eq!(found("grid.times.1"), "\"25:00\"");
        assert_eq!(found("weather.foggy.visibility_m"), "-1");
        assert_eq!(found("weather.foggy"), "foggy");
    }

    #[test]
    fn for_a_key_that_is_not_there_the_table_around_it_is_shown() {
        assert_eq!(found("weather.foggy.clouds"), "foggy");
        assert_eq!(span_of(TEXT, "start.dtd_nm"), None);
    }

    #[test]
    fn a_rejected_value_is_underlined_in_its_line() {
        let file = TomlFile::new(Path::new("sweep.toml"), TEXT);
        let error = file.rejected("grid.times.1", "\"25:00\" is no time; expected HH:MM");
        assert_eq!(
            error.to_string(),
            "sweep.toml:2:19: \"25:00\" is no time; expected HH:MM\n\
             \x20 |\n\
             2 | times = [\"06:00\", \"25:00\"]\n\
             \x20 |                   ^^^^^^^"
        );
    }

    #[test]
    fn mistakes_of_syntax_and_of_type_are_underlined_alike() {
        let error = parse("names = [\"Ann\", 7]\n");
        assert_eq!(error.place, Some((1, 17)));
        assert!(
            error
                .to_string()
                .ends_with("1 | names = [\"Ann\", 7]\n  |                 ^"),
            "{error}"
        );
        let error = parse("# crew\nnames = [\r\n");
        assert!(error.place.is_some(), "{error}");
        assert!(error.to_string().contains('^'), "{error}");
    }

    #[test]
    fn a_number_that_is_expected_is_named_in_words_and_a_bare_time_is_to_be_quoted() {
        #[derive(Debug, Deserialize)]
        #[allow(dead_code, reason = "only read from text")]
        struct Shift {
            times: Vec<Entry>,
            crews: u32,
        }
        #[derive(Debug, Deserialize)]
        #[allow(dead_code, reason = "only read from text")]
        struct Entry {
            from: String,
        }
        let message = |text: &str| {
            let file = TomlFile::new(Path::new("shift.toml"), text);
            file.parse::<Shift>().unwrap_err().message
        };
        assert_eq!(
            message("times = []\ncrews = -1\n"),
            "invalid value: integer `-1`, expected a whole number from 0"
        );
        assert_eq!(
            message("times = []\ncrews = \"two\"\n"),
            "invalid type: string \"two\", expected a whole number from 0"
        );
        assert_eq!(
            message("times = [20:30:00]\ncrews = 1\n"),
            "a time or date without quotes; put it in quotes: \"20:30:00\""
        );
    }

    #[test]
    fn of_a_table_with_a_missing_key_the_first_line_is_shown() {
        let error = parse("captain = \"Ann\"\npilot = \"Bo\"\n");
        let shown = error.to_string();
        assert!(shown.contains("missing field `names`"), "{shown}");
        assert!(
            shown.contains("1 | captain") && !shown.contains("pilot"),
            "{shown}"
        );
    }

    #[test]
    fn a_mistake_in_a_very_long_line_is_shown_in_a_few_columns() {
        let names = "\"Ann\", ".repeat(100_000);
        let error = parse(&format!("names = [{names}7]\n"));
        assert!(error.to_string().contains('^'));
        for line in error.to_string().lines() {
            assert!(
                line.chars().count() <= COLUMNS + 20,
                "{} columns",
                line.len()
            );
        }
    }

    #[test]
    fn every_truncation_of_a_text_is_reported_without_a_panic() {
        for end in 0..TEXT.len() {
            let text = format!("{}ü\r\n= \u{1b}", &TEXT[..end]);
            assert!(parse(&text).to_string().contains("crew.toml:"));
        }
    }
}
