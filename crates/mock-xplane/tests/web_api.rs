//! X-Plane 12's Web API as its clients meet it: over HTTP, against a running stand-in.

use std::net::SocketAddr;
use std::time::Duration;

use mock_xplane::server::ServerOptions;
use serde_json::{Value, json};
use testkit_simulator::client::web_request;
use testkit_simulator::{Running, quiet, web_flight};
use tokio::net::UdpSocket;
use tokio::time::{sleep, timeout};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::packet::{FromSimulator, SubscribePosition, ToSimulator};

/// A stand-in and its Web API.
struct Asked(Running);

async fn start(options: ServerOptions) -> Asked {
    Asked(Running::start(options).await)
}

impl Asked {
    fn web(&self) -> SocketAddr {
        self.0.addresses.web_api.unwrap()
    }

    /// Sends a request on a separate connection; returns status and body.
    async fn request(&self, method: &str, path: &str, body: &Value) -> (u16, Value) {
        self.try_request(method, path, body).await.unwrap()
    }

    /// [`Self::request`]; `None` if there is no answer.
    async fn try_request(&self, method: &str, path: &str, body: &Value) -> Option<(u16, Value)> {
        web_request(self.web(), method, path, body).await
    }

    async fn get(&self, path: &str) -> Value {
        let (status, body) = self.request("GET", path, &Value::Null).await;
        assert_eq!(status, 200, "{path}: {body}");
        body["data"].clone()
    }

    async fn record(&self, list: &str, name: &str) -> Value {
        let found = self
            .get(&format!("/api/v3/{list}?filter[name]={name}"))
            .await;
        assert_eq!(found.as_array().unwrap().len(), 1, "{name}: {found}");
        found[0].clone()
    }

    async fn id(&self, list: &str, name: &str) -> u64 {
        self.record(list, name).await["id"].as_u64().unwrap()
    }

    async fn value(&self, name: &str) -> Value {
        let id = self.id("datarefs", name).await;
        self.get(&format!("/api/v3/datarefs/{id}/value")).await
    }
}

/// Makes a flight wrong.
type Change = fn(&mut Value);

#[tokio::test]
async fn the_list_is_empty_until_a_flight_is_loaded_and_the_flight_has_place_time_and_weather() {
    let running = start(ServerOptions {
        flight_loaded: false,
        ..quiet()
    })
    .await;
    let (_, capabilities) = running
        .request("GET", "/api/capabilities", &Value::Null)
        .await;
    assert_eq!(capabilities["api"]["versions"], json!(["v1", "v2", "v3"]));
    assert_eq!(capabilities["x-plane"]["version"], "12.4.0");
    assert_eq!(running.get("/api/v1/datarefs").await, json!([]));
    assert_eq!(running.get("/api/v1/datarefs/count").await, json!(0));

    let (status, body) = running
        .request("POST", "/api/v3/flight", &web_flight())
        .await;
    assert_eq!((status, body), (200, json!({ "error_code": "success" })));
    let count = running.get("/api/v2/datarefs/count").await;
    assert!(count.as_u64().unwrap() > 50, "{count}");
    assert_eq!(running.value("sim/time/local_date_days").await, json!(79));
    let zulu_s = running
        .value("sim/time/zulu_time_sec")
        .await
        .as_f64()
        .unwrap();
    assert!((81_000.0..81_030.0).contains(&zulu_s), "{zulu_s}");
    let visibility = running
        .value("sim/weather/region/visibility_reported_sm")
        .await;
    assert!(
        (visibility.as_f64().unwrap() - 5.0).abs() < 1e-4,
        "{visibility}"
    );
    let cover = running
        .value("sim/weather/region/cloud_coverage_percent")
        .await;
    assert_eq!(cover, json!([0.75, 0.0, 0.0]));

    // The same world over UDP: the aircraft is there, and flies once it has stopped standing still.
    let udp = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let ask = ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 20 });
    let ask = ask.encode().unwrap();
    udp.send_to(&ask, running.0.addresses.udp).await.unwrap();
    let mut buffer = [0; 128];
    let flying = async {
        loop {
            let length = udp.recv(&mut buffer).await.unwrap();
            assert_eq!(length, 69);
            let Ok(FromSimulator::Position(position)) = FromSimulator::decode(&buffer[..length])
            else {
                panic!("no position");
            };
            if position.velocity_south_mps < -70.0 {
                return position;
            }
        }
    };
    let position = timeout(Duration::from_secs(20), flying).await.unwrap();
    assert!((position.longitude_deg - 103.9).abs() < 0.05);
    assert!((position.elevation_msl_m - 762.0).abs() < 5.0);
    assert_ne!(position.roll_rate_rad_s, 0.0);
}

#[tokio::test]
async fn a_flight_that_is_wrong_is_refused_and_a_whole_number_for_a_float_is_silently_ignored() {
    let running = start(quiet()).await;
    let latitude = running.value("sim/flightmodel/position/latitude").await;
    let changed = |change: Change| {
        let mut flight = web_flight();
        change(&mut flight["data"]);
        flight
    };
    let cases: [(Change, &str); 3] = [
        (
            |data| {
                let weather = data["weather"].as_object_mut().unwrap();
                weather.remove("wave_height_in_meters");
            },
            "wave_height_in_meters",
        ),
        (
            |data| {
                data.as_object_mut().unwrap().remove("aircraft");
            },
            "aircraft",
        ),
        (|data| data["wether"] = json!({}), "wether"),
    ];
    for (change, words) in cases {
        let (status, body) = running
            .request("POST", "/api/v3/flight", &changed(change))
            .await;
        assert_eq!(status, 400, "{words}: {body}");
        assert!(
            body["error_message"].as_str().unwrap().contains(words),
            "{body}"
        );
    }
    // The documented trap.
    let whole = changed(|data| data["lle_air_start"]["elevation_in_meters"] = json!(762));
    let (status, body) = running.request("POST", "/api/v3/flight", &whole).await;
    assert_eq!((status, body), (200, json!({ "error_code": "success" })));
    assert_eq!(
        running.value("sim/flightmodel/position/latitude").await,
        latitude
    );

    let (status, _) = running
        .request("POST", "/api/v2/flight", &web_flight())
        .await;
    assert_eq!(status, 404, "flights came with v3");
}

#[tokio::test]
async fn datarefs_are_listed_read_and_written_with_and_without_index_and_commands_done() {
    let running = start(quiet()).await;
    let latitude = running
        .record("datarefs", "sim/flightmodel/position/latitude")
        .await;
    assert_eq!(latitude["value_type"], "double");
    assert_eq!(latitude["is_writable"], false);
    let id = latitude["id"].as_u64().unwrap();
    let value = format!("/api/v3/datarefs/{id}/value");
    let (status, body) = running
        .request("PATCH", &value, &json!({ "data": 50.0 }))
        .await;
    assert_eq!(
        (status, body["error_code"].as_str()),
        (403, Some("dataref_is_readonly"))
    );

    let clouds = "sim/weather/region/cloud_base_msl_m";
    let id = running.id("datarefs", clouds).await;
    let element = format!("/api/v3/datarefs/{id}/value?index=1");
    let (status, body) = running
        .request("PATCH", &element, &json!({ "data": 600.5 }))
        .await;
    assert_eq!((status, body), (200, Value::Null));
    assert_eq!(running.get(&element).await, json!(600.5));
    let whole = format!("/api/v3/datarefs/{id}/value");
    assert_eq!(running.get(&whole).await, json!([0.0, 600.5, 0.0]));
    running
        .request("PATCH", &whole, &json!({ "data": [1.0, 2.0, 3.0] }))
        .await;
    assert_eq!(running.get(&whole).await, json!([1.0, 2.0, 3.0]));
    let (status, _) = running
        .request("PATCH", &whole, &json!({ "data": 7.0 }))
        .await;
    assert_eq!(status, 400, "a list set like a number");

    // A text, in base 64.
    let file = running.value("sim/aircraft/view/acf_relative_path").await;
    assert_eq!(file, "QWlyY3JhZnQvU3RhbmQtaW4vYWlybGluZXIuYWNm");

    let id = running.id("commands", "sim/operation/pause_on").await;
    let activate = format!("/api/v3/command/{id}/activate");
    let (status, body) = running
        .request("POST", &activate, &json!({ "duration": 0.0 }))
        .await;
    assert_eq!((status, body), (200, Value::Null));
    assert_eq!(running.value("sim/time/paused").await, json!(1));
    let (status, _) = running
        .request("GET", "/api/v1/commands", &Value::Null)
        .await;
    assert_eq!(status, 404, "commands came with v2");
}

#[tokio::test]
async fn with_incoming_traffic_off_everything_is_refused_and_eleven_has_no_web_api() {
    let deaf = start(ServerOptions {
        incoming: false,
        ..quiet()
    })
    .await;
    for path in ["/api/capabilities", "/api/v2/datarefs"] {
        let (status, _) = deaf.request("GET", path, &Value::Null).await;
        assert_eq!(status, 403, "{path}");
    }
    let udp = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let ask = ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 50 });
    let ask = ask.encode().unwrap();
    udp.send_to(&ask, deaf.0.addresses.udp).await.unwrap();
    let answer = timeout(Duration::from_millis(300), udp.recv(&mut [0; 128])).await;
    assert!(answer.is_err(), "an answer over UDP");

    let eleven = start(ServerOptions {
        generation: Generation::XPlane11,
        ..quiet()
    })
    .await;
    assert_eq!(eleven.0.addresses.web_api, None);
}

#[tokio::test]
async fn numbers_of_datarefs_do_not_survive_a_restart() {
    let running = start(ServerOptions {
        faults: "restart=3:0.3".parse().unwrap(),
        ..quiet()
    })
    .await;
    let name = "sim/time/zulu_time_sec";
    let id = running.id("datarefs", name).await;
    let mut last_id = None;
    let other = timeout(Duration::from_secs(10), async {
        while last_id.is_none_or(|last| last == id) {
            sleep(Duration::from_millis(50)).await;
            let list = format!("/api/v3/datarefs?filter[name]={name}");
            let found = running.try_request("GET", &list, &Value::Null).await;
            last_id = found.and_then(|(_, body)| body["data"][0]["id"].as_u64());
        }
    });
    other.await.unwrap();
    let old = format!("/api/v3/datarefs/{id}/value");
    let (status, body) = running.request("GET", &old, &Value::Null).await;
    assert_eq!(
        (status, body["error_code"].as_str()),
        (404, Some("invalid_dataref_id"))
    );
}
