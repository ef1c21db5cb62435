//! Logs go to stderr and results to stdout, so that both can be redirected separately.
//!
//! An event is one line, whatever its fields contain: a peer's text can neither begin a new line nor reach the terminal's control
//! characters. Events about a peer (field `from`) are written once a minute for each place in the code and address.

pub(crate) mod repeats;
pub(crate) mod stderr;

use std::fmt::{Debug, Write};
use std::net::{IpAddr, SocketAddr};

use dataset::plain::one_line;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, registry};

use repeats::Source;
use stderr::Level;

/// Starts logging: warnings by default, `-v` adds events, `-vv` every detail. `RUST_LOG` overrides both.
pub(crate) fn start(verbose: u8) {
    let default = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    registry().with(filter).with(Lines).init();
}

/// Writes events as lines.
struct Lines;

impl<S: Subscriber> Layer<S> for Lines {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let line = Line::of(event);
        let about = event.metadata();
        let level = match *about.level() {
            tracing::Level::ERROR => Level::Error,
            tracing::Level::WARN => Level::Warning,
            tracing::Level::INFO => Level::Info,
            _ => Level::Detail,
        };
        let text = line.text();
        // With -vv every detail is written.
        if level == Level::Detail {
            return stderr::log(level, &text);
        }
        let source = match line.from {
            Some(from) => Source::Peer(about.callsite(), from),
            None => Source::Event(about.callsite(), text.clone()),
        };
        if let Some(repeated) = repeats::admit(source, level, &text) {
            stderr::log(level, &format!("{text}{repeated}"));
        }
    }
}

/// An event as text.
#[derive(Default)]
struct Line {
    message: String,
    /// Each as ` name=value`.
    fields: String,
    /// The peer that it is about.
    from: Option<IpAddr>,
}

impl Line {
    fn of(event: &Event<'_>) -> Self {
        let mut line = Self::default();
        event.record(&mut line);
        line
    }

    fn text(&self) -> String {
        one_line(&format!("{}{}", self.message, self.fields)).into_owned()
    }
}

impl Visit for Line {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let text = format!("{value:?}");
        if field.name() == "from" {
            let address = text.parse().map(|address: SocketAddr| address.ip());
            self.from = address.or_else(|_| text.parse()).ok();
        }
        if field.name() == "message" {
            self.message = text;
        } else {
            // Writing to a string does not fail.
            let _ = write!(self.fields, " {}={text}", field.name());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// Keeps the lines instead of writing them.
    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Vec<Line>>>);

    impl<S: Subscriber> Layer<S> for Kept {
        fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
            self.0.lock().unwrap().push(Line::of(event));
        }
    }

    #[test]
    fn an_event_is_one_line_without_control_characters_and_knows_its_peer() {
        let kept = Kept::default();
        let from: SocketAddr = ([127, 0, 0, 1], 7).into();
        let error = "\u{1b}[31mno\n2026-11-26T00:00:05Z ERROR all is lost\r\u{202e}";
        tracing::subscriber::with_default(registry().with(kept.clone()), || {
            tracing::warn!(%from, %error, "datagram {}", "ignored");
            tracing::warn!(path = "a\u{7}b", "no peer");
        });
        let kept = kept.0.lock().unwrap();
        let text = "datagram ignored from=127.0.0.1:7 error=\\u{1b}[31mno\\n2026-11-26T00:00:05Z ERROR all is lost\\r\\u{202e}";
        assert_eq!(kept[0].text(), text);
        assert_eq!(kept[0].from, Some([127, 0, 0, 1].into()));
        assert_eq!(kept[1].text(), "no peer path=\"a\\u{7}b\"");
        assert_eq!(kept[1].from, None);
    }
}
