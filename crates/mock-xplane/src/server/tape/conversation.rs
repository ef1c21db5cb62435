//! The recorded requests of the capture link, looked up by their content.
//!
//! A tape may contain the same capture under several skies: a flight recorded once and replayed in two weathers. So requests for images and
//! flights are looked up together with what clients had written since the link was opened, and match only under the same. Among equal
//! requests the next one on the tape is taken.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;

use serde_json::Value;
use xplane_tape::MessagePosition;

/// Maximum relative difference between results of the same computation on two machines.
const SAME_NUMBER: f64 = 1e-9;

/// Writes of clients, by dataref. Bits, since a sky is identical or not.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(super) struct Context(BTreeMap<String, u32>);

impl Context {
    pub(super) fn write(&mut self, path: &str, value: f32) {
        self.0.insert(path.to_owned(), value.to_bits());
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// The first dataref with a different written value.
    fn difference(&self, recorded: &Self) -> Option<String> {
        let say = |value: Option<&u32>| match value {
            Some(bits) => f32::from_bits(*bits).to_string(),
            None => "not written".to_owned(),
        };
        let mut paths = self.0.keys().chain(recorded.0.keys());
        let path = paths.find(|path| self.0.get(*path) != recorded.0.get(*path))?;
        Some(format!(
            "{path} was {} then, and is {} now",
            say(recorded.0.get(path)),
            say(self.0.get(path))
        ))
    }
}

/// A request's subject, for finding similar requests.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Subject {
    message: String,
    tick: Option<u64>,
    view: Option<u64>,
}

impl Subject {
    fn of(request: &Value) -> Self {
        let number = |key| request.get(key).and_then(Value::as_u64);
        let message = request.get("message").and_then(Value::as_str);
        Self {
            message: message.unwrap_or("nameless").to_owned(),
            tick: number("tick"),
            view: number("view"),
        }
    }

    /// True if the answer depends on earlier writes.
    fn shows_the_world(&self) -> bool {
        matches!(self.message.as_str(), "capture" | "fly")
    }

    fn name(&self) -> String {
        match (self.tick, self.view) {
            (Some(tick), Some(view)) => format!("{} of tick {tick}, view {view}", self.message),
            _ => self.message.clone(),
        }
    }
}

#[derive(Debug)]
struct Exchange {
    context: usize,
    request: MessagePosition,
    answer: MessagePosition,
}

/// All requests on a tape with their answers.
#[derive(Debug, Default)]
pub(super) struct Conversation {
    exchanges: Vec<Exchange>,
    contexts: Vec<Context>,
    by_content: HashMap<[u8; 32], Vec<usize>>,
    by_subject: HashMap<Subject, Vec<usize>>,
    /// After the last match.
    at: usize,
}

impl Conversation {
    /// Adds a request from the tape, in order.
    pub(super) fn add(
        &mut self,
        request: &Value,
        context: &Context,
        at: MessagePosition,
        answer: MessagePosition,
    ) {
        if self.contexts.last() != Some(context) {
            self.contexts.push(context.clone());
        }
        let number = self.exchanges.len();
        self.exchanges.push(Exchange {
            context: self.contexts.len() - 1,
            request: at,
            answer,
        });
        self.by_content
            .entry(content(request))
            .or_default()
            .push(number);
        self.by_subject
            .entry(Subject::of(request))
            .or_default()
            .push(number);
    }

    /// Number of requests.
    pub(super) fn count(&self) -> usize {
        self.exchanges.len()
    }

    /// Finds the answer to a request; the error names the request and what the tape has. `reread` gets a recorded request from the tape.
    pub(super) fn find(
        &mut self,
        request: &Value,
        now: &Context,
        mut reread: impl FnMut(MessagePosition) -> Option<Value>,
    ) -> Result<MessagePosition, String> {
        let subject = Subject::of(request);
        let mut equal = self
            .by_content
            .get(&content(request))
            .cloned()
            .unwrap_or_default();
        let alike = self.by_subject.get(&subject).cloned().unwrap_or_default();
        if equal.is_empty() {
            let mut same = |number: &usize| {
                let recorded = reread(self.exchanges[*number].request);
                recorded.is_some_and(|recorded| difference(request, &recorded).is_none())
            };
            equal = alike
                .iter()
                .copied()
                .filter(|number| same(number))
                .collect();
        }
        let fits = |number: &&usize| {
            !subject.shows_the_world() || self.contexts[self.exchanges[**number].context] == *now
        };
        let next = equal.iter().filter(fits).find(|number| **number >= self.at);
        if let Some(&found) = next.or_else(|| equal.iter().find(fits)) {
            self.at = found + 1;
            return Ok(self.exchanges[found].answer);
        }
        let mut text = format!("the tape has no {}", subject.name());
        let nearest = |numbers: &[usize]| {
            let next = numbers.iter().find(|number| **number >= self.at);
            next.or(numbers.first()).copied()
        };
        if let Some(number) = nearest(&equal) {
            let then = &self.contexts[self.exchanges[number].context];
            let what = now.difference(then).unwrap_or_default();
            let _ = write!(text, " under these datarefs: {what}");
        } else if let Some(number) = nearest(&alike) {
            let recorded = reread(self.exchanges[number].request);
            let what = recorded.and_then(|recorded| difference(request, &recorded));
            let _ = write!(text, " like this: {}", what.unwrap_or_default());
        }
        let _ = write!(text, ". It has {}", self.inventory());
        Err(text)
    }

    /// Contents of the tape, as text.
    fn inventory(&self) -> String {
        let mut counts: BTreeMap<&str, (usize, u64, u64)> = BTreeMap::new();
        for (subject, numbers) in &self.by_subject {
            let (count, ticks, views) = counts.entry(&subject.message).or_default();
            *count += numbers.len();
            *ticks = (*ticks).max(subject.tick.unwrap_or(0));
            *views = (*views).max(subject.view.unwrap_or(0));
        }
        let say = |(message, (count, tick, view)): (&str, (usize, u64, u64))| match message {
            "capture" => format!("{count} capture (ticks 0 to {tick}, views 0 to {view})"),
            _ => format!("{count} {message}"),
        };
        let all: Vec<String> = counts.into_iter().map(say).collect();
        if all.is_empty() {
            "no requests of the capture link".into()
        } else {
            all.join(", ")
        }
    }
}

/// Hash of a request's content, independent of its sender.
fn content(request: &Value) -> [u8; 32] {
    let text = match request.get("message") {
        Some(message) if message == "hello" => "hello".to_owned(),
        // Keys are in alphabetical order.
        _ => request.to_string(),
    };
    *blake3::hash(text.as_bytes()).as_bytes()
}

/// The first difference between two requests, beyond rounding.
fn difference(asked: &Value, recorded: &Value) -> Option<String> {
    fn at(path: &str, asked: Option<&Value>, recorded: Option<&Value>) -> Option<String> {
        match (asked, recorded) {
            (Some(Value::Object(a)), Some(Value::Object(b))) => {
                let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
                let mut found = keys.filter_map(|key| {
                    let path = if path.is_empty() {
                        key.clone()
                    } else {
                        format!("{path}.{key}")
                    };
                    at(&path, a.get(key), b.get(key))
                });
                found.next()
            }
            (Some(Value::Number(a)), Some(Value::Number(b))) => {
                let (a, b) = (a.as_f64()?, b.as_f64()?);
                let limit = SAME_NUMBER * a.abs().max(b.abs()).max(1.0);
                ((a - b).abs() > limit).then(|| format!("{path} was {b} then, and is {a} now"))
            }
            (a, b) if a == b => None,
            (a, b) => {
                let say = |value: Option<&Value>| value.map_or("missing".into(), Value::to_string);
                Some(format!("{path} was {} then, and is {} now", say(b), say(a)))
            }
        }
    }
    at("", Some(asked), Some(recorded))
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use std::path::Path;
    use xplane_tape::{Channel, Direction, TapeReader, TapeWriter, Traffic};

    use super::*;

    /// Requests on a separate tape, since places are the tape's.
    fn recorded(
        folder: &Path,
        requests: &[(Value, f32)],
    ) -> (Conversation, Vec<MessagePosition>, TapeReader) {
        let path = folder.join("a.mcap");
        let channel = Channel {
            traffic: Traffic::Link,
            number: 1,
            direction: Direction::ToSimulator,
        };
        let mut tape = TapeWriter::create(&path, "x", "now").unwrap();
        for (request, _) in requests {
            tape.write(channel, 0, request.to_string().as_bytes())
                .unwrap();
        }
        tape.finish().unwrap();
        let mut tape = TapeReader::open(&path).unwrap();
        let (mut conversation, mut places) = (Conversation::default(), Vec::new());
        for (request, visibility) in requests {
            let place = tape.next_entry().unwrap().unwrap().place;
            conversation.add(request, &sky(*visibility), place, place);
            places.push(place);
        }
        (conversation, places, tape)
    }

    fn sky(visibility: f32) -> Context {
        let mut context = Context::default();
        context.write("visibility", visibility);
        context
    }

    fn capture(tick: u32, latitude_deg: f64) -> Value {
        json!({"message": "capture", "tick": tick, "view": 0, "pose": {"latitude_deg": latitude_deg}})
    }

    #[test]
    fn a_capture_is_found_under_its_own_sky_and_a_repeated_one_in_the_order_of_the_tape() {
        let folder = tempfile::tempdir().unwrap();
        let requests = [
            (capture(0, 1.0), 10.0),
            (capture(0, 1.0), 80.0),
            (capture(0, 1.0), 80.0),
        ];
        let (mut tape, places, _) = recorded(folder.path(), &requests);
        let mut find = |visibility| tape.find(&capture(0, 1.0), &sky(visibility), |_| None);
        assert_eq!(find(80.0), Ok(places[1]));
        assert_eq!(find(80.0), Ok(places[2]));
        assert_eq!(find(80.0), Ok(places[1]));
        assert_eq!(find(10.0), Ok(places[0]));
        let error = find(50.0).unwrap_err();
        assert!(
            error.contains("visibility was 80 then, and is 50 now"),
            "{error}"
        );
        assert!(error.contains("3 capture (ticks 0 to 0"), "{error}");
    }

    #[test]
    fn rounding_is_forgiven_and_anything_more_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (mut conversation, places, mut tape) =
            recorded(folder.path(), &[(capture(3, 1.35), 10.0)]);
        let mut reread = |place| serde_json::from_slice(&tape.read_again(place).unwrap()).ok();
        let found = conversation.find(&capture(3, 1.35 + 1e-14), &sky(10.0), &mut reread);
        assert_eq!(found, Ok(places[0]));
        let error = conversation
            .find(&capture(3, 1.36), &sky(10.0), &mut reread)
            .unwrap_err();
        assert!(
            error.contains("pose.latitude_deg was 1.35 then, and is 1.36 now"),
            "{error}"
        );
        let error = conversation
            .find(&capture(4, 1.35), &sky(10.0), &mut reread)
            .unwrap_err();
        assert!(
            error.contains("no capture of tick 4, view 0") && error.contains("ticks 0 to 3"),
            "{error}"
        );
    }

    #[test]
    fn who_says_hello_does_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let hello = |client: &str| json!({"message": "hello", "client": client});
        let (mut tape, places, _) = recorded(folder.path(), &[(hello("dtd 0.1.0"), 10.0)]);
        let found = tape.find(&hello("another"), &sky(1.0), |_| None);
        assert_eq!(found, Ok(places[0]));
    }
}
