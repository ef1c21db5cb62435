//! Awkward habits of a live X-Plane, over the sockets that its clients use.

use std::sync::Arc;
use std::time::{Duration, Instant};

use mock_xplane::server::{Addresses, BuiltIn, ServerOptions};
use serde_json::{Value, json};
use testkit_simulator::client::web_request;
use testkit_simulator::{quiet, serving_with, web_flight};
use tokio::time::timeout;

const COVER: &str = "sim/weather/region/cloud_coverage_percent";
const LATITUDE: &str = "sim/flightmodel/position/latitude";
const LOADING: &str = "sim/graphics/scenery/async_scenery_load_in_progress";
/// Longer than any operation takes, however busy the machine.
const PATIENCE: Duration = Duration::from_secs(60);

async fn start(quirks: &str, clock_rate: f64) -> Addresses {
    let options = ServerOptions {
        quirks: quirks.parse().unwrap(),
        clock_rate,
        ..quiet()
    };
    let (addresses, _) = serving_with(options, Arc::new(BuiltIn)).await;
    addresses
}

/// The body of an answer; `None` if the connection was closed without one.
async fn request(addresses: Addresses, method: &str, path: &str, body: &Value) -> Option<Value> {
    let path = format!("/api{path}");
    let answer = web_request(addresses.web_api?, method, &path, body).await;
    answer.map(|(_, body)| body)
}

async fn id(addresses: Addresses, list: &str, name: &str) -> Value {
    let path = format!("/v3/{list}?filter[name]={name}");
    let found = request(addresses, "GET", &path, &Value::Null)
        .await
        .unwrap();
    found["data"][0]["id"].clone()
}

async fn value(addresses: Addresses, name: &str) -> Value {
    let path = format!(
        "/v3/datarefs/{}/value",
        id(addresses, "datarefs", name).await
    );
    let found = request(addresses, "GET", &path, &Value::Null)
        .await
        .unwrap();
    found["data"].clone()
}

async fn write(addresses: Addresses, name: &str, data: Value) {
    let path = format!(
        "/v3/datarefs/{}/value",
        id(addresses, "datarefs", name).await
    );
    request(addresses, "PATCH", &path, &json!({ "data": data }))
        .await
        .unwrap();
}

/// Waits until a dataref is as it should be.
async fn until(addresses: Addresses, name: &str, right: impl Fn(&Value) -> bool) {
    let waited = timeout(PATIENCE, async {
        while !right(&value(addresses, name).await) {}
    });
    waited
        .await
        .unwrap_or_else(|_| panic!("{name} is not as it should be"));
}

#[tokio::test]
async fn clouds_come_late_by_the_simulators_clock_which_may_run_faster() {
    let addresses = start("late_clouds", 100.0).await;
    let began = Instant::now();
    write(addresses, COVER, json!([0.5, 0.25, 0.0])).await;
    assert_eq!(value(addresses, COVER).await, json!([0.0, 0.0, 0.0]));
    until(addresses, COVER, |cover| *cover == json!([0.5, 0.25, 0.0])).await;
    // 55 s at 100 times the speed; frames that a busy machine skips only make it longer.
    assert!(began.elapsed() >= Duration::from_millis(500));
}

#[tokio::test]
async fn a_start_whose_connection_is_dropped_succeeds_and_its_scenery_loads() {
    let addresses = start("dropped_start,far_away,slow_scenery", 20.0).await;
    let away = value(addresses, LATITUDE).await.as_f64().unwrap();
    assert!(away > 9.0, "{away}");
    let answer = request(addresses, "POST", "/v3/flight", &web_flight()).await;
    assert_eq!(answer, None);
    until(addresses, LATITUDE, |now| now.as_f64().unwrap() < 2.0).await;
    until(addresses, LOADING, |loading| *loading == json!(1)).await;
    until(addresses, LOADING, |loading| *loading == json!(0)).await;
}

#[tokio::test]
async fn without_quirks_a_start_is_answered_and_clouds_read_as_written() {
    let addresses = start("none", 1.0).await;
    let answer = request(addresses, "POST", "/v3/flight", &web_flight()).await;
    assert_eq!(answer, Some(json!({ "error_code": "success" })));
    write(addresses, COVER, json!([0.5, 0.25, 0.0])).await;
    assert_eq!(value(addresses, COVER).await, json!([0.5, 0.25, 0.0]));
    let icao = value(addresses, "sim/aircraft/view/acf_ICAO").await;
    assert!(
        icao.as_str().is_some_and(|text| text.starts_with("QjczO")),
        "{icao}"
    );
}

#[tokio::test]
async fn a_regeneration_freezes_everybody_for_three_seconds_of_the_simulators_clock() {
    let addresses = start("regeneration_freeze", 3.0).await;
    let command = id(addresses, "commands", "sim/operation/regen_weather").await;
    let path = format!("/v3/command/{command}/activate");
    request(addresses, "POST", &path, &json!({ "duration": 0.0 })).await;
    // The freeze begins with the next frame: one of the following answers takes most of a second.
    let frozen = timeout(PATIENCE, async {
        loop {
            let asked = Instant::now();
            value(addresses, COVER).await;
            if asked.elapsed() > Duration::from_millis(800) {
                return;
            }
        }
    });
    assert!(frozen.await.is_ok(), "nothing froze");
}
