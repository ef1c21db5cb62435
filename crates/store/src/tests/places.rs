//! Prefixes in which a corpus may be written, and those that hold the work of others.

use super::*;

/// The least that is recognized as a plan.
const PLAN: &str = r#"{"plan_hash": "0", "scenarios": []}"#;

#[tokio::test]
async fn a_prefix_with_objects_of_others_is_refused_and_a_corpus_with_notes_is_not() {
    let (_folder, stores) = stores();
    for store in stores {
        at(&store).check_place().await.unwrap();
        for own in ["corpus.toml", "splits.json", "plan.json"] {
            put(&store, own, "").await;
        }
        put(&store, "failed/1200-clear-r1.json", "{}").await;
        at(&store).check_place().await.unwrap();
        for (name, text) in [
            ("plan.json", r#"{"planned_values": {}}"#),
            ("splits.json", r#"{"train": [1]}"#),
            ("corpus.toml", "[corpus]"),
            ("scenarios/one/notes.json", "{}"),
            ("thesis.tex", "% a thesis"),
            ("data/a.csv", "1"),
        ] {
            put(&store, name, text).await;
            let placed = at(&store).check_place().await;
            if name.starts_with("scenarios/") {
                // It is kept as it is.
                placed.unwrap();
            } else {
                let error = placed.unwrap_err();
                assert!(error.is_bad_input(), "{name}: {error}");
                let (entry, _) = name.split_once('/').unwrap_or((name, ""));
                assert!(error.to_string().contains(entry), "{name}: {error}");
                // With a plan, it is a corpus in which somebody keeps notes.
                put(&store, Corpus::PLAN, PLAN).await;
                at(&store).check_place().await.unwrap();
            }
            let key = store.key(name);
            let _ = store.client.delete(&key).await;
            let _ = store.client.delete(&store.key(Corpus::PLAN)).await;
        }
    }
}

#[tokio::test]
async fn a_damaged_plan_beside_a_committed_scenario_is_the_corpus_own() {
    let (store, ..) = pushed().await;
    put(&store, Corpus::PLAN, "{").await;
    at(&store).check_place().await.unwrap();
}
