//! The quirks of the bundled simulator.

use mock_xplane::quirks::FACTS;

use super::markdown;

pub(super) fn table() -> String {
    let yes = |applies: bool| String::from(if applies { "yes" } else { "" });
    let rows = FACTS.map(|facts| {
        [
            format!("`{}`", facts.name),
            facts.does.to_owned(),
            format!("{}; {}", facts.source, facts.grade),
            yes(facts.costs_time),
            yes(facts.in_11),
        ]
    });
    markdown::table(
        ["name", "effect", "source; grade", "clients wait", "in 11"],
        &rows,
    )
}
