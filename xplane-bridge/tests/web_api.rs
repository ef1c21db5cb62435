//! The Web API's requests, and how answers documented by X-Plane 12 are handled.

mod fake_web_api;

use std::net::SocketAddr;
use std::time::Duration;

use fake_web_api::{CAPABILITIES, server};
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpListener;
use xplane_bridge::web_api::{MAX_ANSWER_BYTES, WebApi, WebApiError};

const VISIBILITY: &str = "sim/weather/region/visibility_reported_sm";
const SECOND: Duration = Duration::from_secs(1);

#[tokio::test]
async fn a_dataref_is_looked_up_and_read() {
    let (address, _) = server(&[
        ("GET /api/capabilities", 200, CAPABILITIES),
        (
            "GET /api/v3/datarefs?filter%5Bname%5D=sim%2Fweather%2Fregion%2Fvisibility_reported_sm",
            200,
            r#"{"data":[{"id":8,"is_writable":true,"name":"sim/weather/region/visibility_reported_sm","value_type":"float"}]}"#,
        ),
        ("GET /api/v3/datarefs/8/value", 200, r#"{"data":21.5}"#),
    ])
    .await;
    let api = WebApi::connect(address, SECOND).await.unwrap();
    assert_eq!(
        (api.simulator_version(), api.has_flights()),
        ("12.4.0", true)
    );
    assert_eq!(api.read_number(VISIBILITY).await.unwrap(), 21.5);
}

#[tokio::test]
async fn a_flight_is_begun_with_its_body_in_a_data_field_and_a_refusal_is_passed_on() {
    let (address, requests) = server(&[
        ("GET /api/capabilities", 200, CAPABILITIES),
        (
            "POST /api/v3/flight",
            400,
            r#"{"error_code":"invalid_flight","error_message":"weather.definition is incomplete"}"#,
        ),
    ])
    .await;
    let api = WebApi::connect(address, SECOND).await.unwrap();
    let error = api
        .start_flight(&serde_json::json!({ "speed": 10.0 }))
        .await
        .unwrap_err();
    assert!(
        error.to_string().contains("400") && error.to_string().contains("is incomplete"),
        "{error}"
    );
    let last = requests.lock().unwrap().last().cloned().unwrap();
    assert_eq!(
        last,
        (
            "POST /api/v3/flight".into(),
            r#"{"data":{"speed":10.0}}"#.into()
        )
    );
}

#[tokio::test]
async fn what_is_not_there_is_told_apart_nobody_forbidden_no_flight_loaded_and_the_first_version() {
    let free = TcpListener::bind("127.0.0.1:0")
        .await
        .unwrap()
        .local_addr()
        .unwrap();
    let error = WebApi::connect(free, SECOND).await.unwrap_err();
    assert!(matches!(error, WebApiError::NotReached { .. }), "{error}");

    let (address, _) = server(&[("GET /api/capabilities", 403, "")]).await;
    let error = WebApi::connect(address, SECOND).await.unwrap_err();
    assert!(
        error.to_string().contains("Accept incoming connections"),
        "{error}"
    );

    let (address, _) = server(&[
        ("GET /api/capabilities", 200, CAPABILITIES),
        ("GET /api/v3/datarefs?", 200, r#"{"data":[]}"#),
    ])
    .await;
    let api = WebApi::connect(address, SECOND).await.unwrap();
    let error = api.read_number(VISIBILITY).await.unwrap_err();
    assert!(matches!(error, WebApiError::Unknown { .. }), "{error}");
    assert!(
        error.to_string().contains("Before a flight is loaded"),
        "{error}"
    );

    // 12.1.1 has no capabilities to ask for.
    let (address, _) = server(&[(
        "GET /api/v1/datarefs?",
        200,
        r#"{"data":[{"id":8,"name":"sim/weather/region/visibility_reported_sm","value_type":"float"}]}"#,
    )])
    .await;
    let api = WebApi::connect(address, SECOND).await.unwrap();
    assert!(!api.has_flights());
    assert_eq!(api.dataref(VISIBILITY).await.unwrap().id, 8);

    let (address, _) = server(&[("GET /api/capabilities", 200, "<html>")]).await;
    let error = WebApi::connect(address, SECOND).await.unwrap_err();
    assert!(matches!(error, WebApiError::WrongAnswer(_)), "{error}");
}

/// A server whose answer to anything is a JSON text, padded to this many bytes; endless without a number.
async fn long_winded(bytes: Option<usize>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let mut stream = BufReader::new(stream);
            let mut line = String::new();
            while stream.read_line(&mut line).await.unwrap() > 2 {
                line.clear();
            }
            let length = bytes.map_or(String::new(), |bytes| {
                format!("Content-Length: {bytes}\r\n")
            });
            let head =
                format!("HTTP/1.1 200 OK\r\nConnection: close\r\n{length}\r\n{CAPABILITIES}");
            stream.write_all(head.as_bytes()).await.unwrap();
            let mut left = bytes.map_or(usize::MAX, |bytes| bytes - CAPABILITIES.len());
            while left > 0 {
                let part = [b' '; 4096];
                let part = &part[..left.min(part.len())];
                if stream.write_all(part).await.is_err() {
                    break;
                }
                left -= part.len();
            }
        }
    });
    address
}

#[tokio::test]
async fn an_answer_may_have_64_kib_and_one_that_never_ends_is_cut_off() {
    let longest = long_winded(Some(MAX_ANSWER_BYTES)).await;
    let api = WebApi::connect(longest, 10 * SECOND).await.unwrap();
    assert_eq!(api.simulator_version(), "12.4.0");
    for beyond in [Some(MAX_ANSWER_BYTES + 1), None] {
        let refused = WebApi::connect(long_winded(beyond).await, 10 * SECOND).await;
        let error = refused.unwrap_err();
        assert!(
            error.to_string().contains("more than 65536 bytes"),
            "{error}"
        );
    }
}

#[tokio::test]
async fn a_redirect_is_not_followed() {
    let (other, requests) = server(&[("GET /", 200, CAPABILITIES)]).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        assert!(stream.read(&mut [0; 4_096]).await.unwrap() > 0);
        let head = format!(
            "HTTP/1.1 302 X\r\nConnection: close\r\nContent-Length: 0\r\nLocation: http://{other}/\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).await.unwrap();
        // Until the client closes.
        let _ = stream.read_to_end(&mut Vec::new()).await;
    });
    let error = WebApi::connect(address, SECOND).await.unwrap_err();
    assert!(
        matches!(error, WebApiError::Refused { status: 302, .. }),
        "{error}"
    );
    assert!(requests.lock().unwrap().is_empty());
}
