//! X-Plane 12's own Web API: HTTP with JSON on the simulator's computer, since 12.1.1.
//!
//! Input: an address (X-Plane answers only on 127.0.0.1:8086). Output: datarefs read, flights started; all acknowledged, unlike with UDP.
//! The API of each version has what earlier ones have: v1 has datarefs, v3 (12.4.0) flights. Identifiers are valid for one session of the
//! simulator, so every call looks up its own.

mod flight;

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use reqwest::redirect::Policy;
use reqwest::{Client, Method, RequestBuilder, StatusCode};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::error::causes::with_causes;
use crate::error::peer_text::quoted;
use futures_util::future::BoxFuture;

pub use flight::AirStart;
pub(crate) use flight::flight_body;

/// X-Plane's default port, which `--web_server_port` changes.
pub(crate) const DEFAULT_ADDRESS: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 8086);
/// Maximum body of an answer: the longest expected one, an array's value, has a few KiB.
pub const MAX_ANSWER_BYTES: usize = 64 << 10;
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Timeout of starting a flight: X-Plane loads the aircraft and the scenery first.
const FLIGHT_TIMEOUT: Duration = Duration::from_secs(180);

/// Failed call to the Web API.
#[derive(Debug, thiserror::Error)]
pub enum WebApiError {
    /// No HTTP server answers there in time.
    #[error("no Web API at {address}, while {doing}: {}", with_causes(source))]
    NotReached {
        /// Address of the request.
        address: SocketAddr,
        /// Purpose of the request.
        doing: String,
        /// Underlying error.
        r#source: reqwest::Error,
    },
    /// X-Plane rejects all requests.
    #[error(
        "X-Plane refuses its Web API at {address}: switch on Settings > Network > \"Accept incoming connections\""
    )]
    Forbidden {
        /// Address of the request.
        address: SocketAddr,
    },
    /// A dataref that the simulator does not have now.
    #[error(
        "the simulator at {address} has no dataref {name}. Before a flight is loaded it has none at all"
    )]
    Unknown {
        /// Address of the request.
        address: SocketAddr,
        /// Name.
        name: String,
    },
    /// It answered with an error.
    #[error("the Web API at {address} answered {status} to {doing}: {text}")]
    Refused {
        /// Address of the request.
        address: SocketAddr,
        /// The HTTP status.
        status: u16,
        /// Purpose of the request.
        doing: String,
        /// Text of the refusal.
        text: String,
    },
    /// An answer that is too long, or has another form than the Web API's.
    #[error("{0}")]
    WrongAnswer(String),
}

/// A dataref as the simulator lists it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Entry {
    /// Number in this simulator session.
    pub id: u64,
    /// Name.
    pub name: String,
}

/// X-Plane's Web API.
#[derive(Debug, Clone)]
pub struct WebApi {
    http: Client,
    address: SocketAddr,
    capabilities: Capabilities,
}

#[derive(Debug, Clone, Deserialize)]
struct Capabilities {
    api: Versions,
    #[serde(rename = "x-plane")]
    simulator: SimulatorVersion,
}

#[derive(Debug, Clone, Deserialize)]
struct Versions {
    versions: Vec<String>,
}

#[derive(Debug, Clone, Deserialize)]
struct SimulatorVersion {
    version: String,
}

/// The envelope of every answer.
#[derive(Deserialize)]
struct Data<T> {
    data: T,
}

/// Error format.
#[derive(Deserialize)]
struct Problem {
    error_message: Option<String>,
    error_code: Option<String>,
}

impl WebApi {
    /// Queries the simulator's identity, waiting at most `timeout`.
    ///
    /// # Errors
    /// [`WebApiError::NotReached`] if there is none, [`WebApiError::Forbidden`] if X-Plane accepts no connections.
    pub fn connect(
        address: SocketAddr,
        timeout: Duration,
    ) -> BoxFuture<'static, Result<Self, WebApiError>> {
        Box::pin(async move {
            let doing = "asking for its capabilities";
            // Everything goes to this address: through no proxy of the environment, and to no other address that an answer names.
            let http = Client::builder()
                .no_proxy()
                .redirect(Policy::none())
                .connect_timeout(timeout)
                .build()
                .map_err(|source| not_reached(address, doing, source))?;
            // No version in the path. The first version of the API, 12.1.1, has no such page.
            let request = http
                .get(format!("http://{address}/api/capabilities"))
                .timeout(timeout);
            let capabilities = match send(address, doing, request).await {
                Ok(capabilities) => capabilities,
                Err(WebApiError::Refused { status: 404, .. }) => Capabilities {
                    api: Versions {
                        versions: vec!["v1".into()],
                    },
                    simulator: SimulatorVersion {
                        version: "12.1.1".into(),
                    },
                },
                Err(error) => return Err(error),
            };
            Ok(Self {
                http,
                address,
                capabilities,
            })
        })
    }

    /// The simulator's version, e.g. `12.4.0`.
    pub fn simulator_version(&self) -> &str {
        &self.capabilities.simulator.version
    }

    /// True if starting flights is supported (since X-Plane 12.4.0).
    pub fn has_flights(&self) -> bool {
        let versions = &self.capabilities.api.versions;
        versions.iter().any(|found| found == "v3")
    }

    /// The newest version that both sides support.
    fn newest(&self) -> &'static str {
        if self.has_flights() { "v3" } else { "v1" }
    }

    /// Looks a dataref up.
    ///
    /// # Errors
    /// [`WebApiError::Unknown`] if the simulator does not have it, now or at all.
    pub fn dataref<'a>(&'a self, name: &'a str) -> BoxFuture<'a, Result<Entry, WebApiError>> {
        Box::pin(async move {
            let unknown = || WebApiError::Unknown {
                address: self.address,
                name: name.to_owned(),
            };
            let request = self.request(Method::GET, &format!("{}/datarefs", self.newest()));
            let request = request.query(&[("filter[name]", name)]);
            let doing = format!("looking for dataref {name}");
            match send::<Data<Vec<Entry>>>(self.address, &doing, request).await {
                Ok(found) => found
                    .data
                    .into_iter()
                    .find(|entry| entry.name == name)
                    .ok_or_else(unknown),
                Err(WebApiError::Refused { status: 404, .. }) => Err(unknown()),
                Err(error) => Err(error),
            }
        })
    }

    /// Reads a dataref that is one number.
    ///
    /// # Errors
    /// If the simulator does not have it, does not answer, or it is not a number.
    pub fn read_number<'a>(&'a self, name: &'a str) -> BoxFuture<'a, Result<f64, WebApiError>> {
        Box::pin(async move {
            let entry = self.dataref(name).await?;
            let path = format!("{}/datarefs/{}/value", self.newest(), entry.id);
            let request = self.request(Method::GET, &path);
            let doing = format!("reading {name}");
            let found = send::<Data<Value>>(self.address, &doing, request).await?;
            found.data.as_f64().ok_or_else(|| {
                WebApiError::WrongAnswer(format!(
                    "the Web API at {} answered {} to {doing}, expected a number",
                    self.address,
                    quoted(&found.data.to_string())
                ))
            })
        })
    }

    /// Starts a flight; see [`flight_body`]. Returns when the simulator reports that it has started.
    ///
    /// # Errors
    /// If the simulator refuses, or is older than 12.4.0.
    pub fn start_flight<'a>(&'a self, flight: &'a Value) -> BoxFuture<'a, Result<(), WebApiError>> {
        Box::pin(async move {
            let request = self.request(Method::POST, "v3/flight");
            let request = request.timeout(FLIGHT_TIMEOUT);
            let request = request.json(&json!({ "data": flight }));
            answer(self.address, "beginning a flight", request).await?;
            Ok(())
        })
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        let url = format!("http://{}/api/{path}", self.address);
        self.http.request(method, url).timeout(ANSWER_TIMEOUT)
    }
}

/// Sends a request and reads what comes back.
async fn send<T: DeserializeOwned>(
    address: SocketAddr,
    doing: &str,
    request: RequestBuilder,
) -> Result<T, WebApiError> {
    let text = answer(address, doing, request).await?;
    serde_json::from_str(&text).map_err(|error| {
        WebApiError::WrongAnswer(format!(
            "the Web API at {address} answered {} to {doing}, expected the form that X-Plane's Web API documents",
            quoted(&format!("{error} in {text}"))
        ))
    })
}

/// The text of a successful answer.
async fn answer(
    address: SocketAddr,
    doing: &str,
    request: RequestBuilder,
) -> Result<String, WebApiError> {
    let mut response = request
        .header("Accept", "application/json")
        .send()
        .await
        .map_err(|source| not_reached(address, doing, source))?;
    let status = response.status();
    let mut body = Vec::new();
    while let Some(part) = response
        .chunk()
        .await
        .map_err(|source| not_reached(address, doing, source))?
    {
        if body.len() + part.len() > MAX_ANSWER_BYTES {
            return Err(WebApiError::WrongAnswer(format!(
                "the Web API at {address} answered more than {MAX_ANSWER_BYTES} bytes to {doing}. Does another program listen there?"
            )));
        }
        body.extend_from_slice(&part);
    }
    let text = String::from_utf8_lossy(&body).into_owned();
    match status {
        status if status.is_success() => Ok(text),
        StatusCode::FORBIDDEN => Err(WebApiError::Forbidden { address }),
        status => {
            let said = serde_json::from_str::<Problem>(&text)
                .ok()
                .and_then(|problem| problem.error_message.or(problem.error_code));
            Err(WebApiError::Refused {
                address,
                status: status.as_u16(),
                doing: doing.to_owned(),
                text: quoted(said.as_ref().unwrap_or(&text)),
            })
        }
    }
}

fn not_reached(address: SocketAddr, doing: &str, source: reqwest::Error) -> WebApiError {
    WebApiError::NotReached {
        address,
        doing: doing.to_owned(),
        // The address is in the message already.
        source: source.without_url(),
    }
}
