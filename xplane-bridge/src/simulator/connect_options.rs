//! Connection options besides the address: from the caller or the environment.
//!
//! An invalid variable is an error that names it. Ignoring it would record scenarios in an unintended way.

pub(crate) mod find_web_api;
pub(crate) mod main_menu;

use std::env::{self, VarError};
use std::net::{SocketAddr, ToSocketAddrs};
use std::str::FromStr;

use crate::error::BridgeError;
use crate::udp::socket::LocalUdp;
use crate::web_api;

/// Environment variable with the token of a capture link that is open to other machines.
pub const LINK_TOKEN_VARIABLE: &str = "DTD_LINK_TOKEN";
/// Environment variable with the address of X-Plane 12's Web API (HOST:PORT), or `off` to disable it.
pub const WEB_API_VARIABLE: &str = "DTD_WEB_API";

/// Connection options besides the address.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ConnectOptions {
    /// The token for a capture link that is open to other machines.
    pub token: Option<String>,
    /// Address of X-Plane 12's Web API, if it may be used. It is used if it belongs to the same simulator.
    pub web_api: Option<SocketAddr>,
    /// Port of the simulator's own capture link, if a recorder's stands in its place: the Web API names the simulator's.
    pub own_link_port: Option<u16>,
    /// The local side of UDP.
    pub local_udp: LocalUdp,
}

impl ConnectOptions {
    /// The environment's options ([`LINK_TOKEN_VARIABLE`], [`WEB_API_VARIABLE`]) for the simulator at `address`.
    ///
    /// # Errors
    /// [`BridgeError::BadVariable`] if [`WEB_API_VARIABLE`] is neither `off` nor an address.
    pub fn from_environment(address: SocketAddr) -> Result<Self, BridgeError> {
        Ok(Self {
            token: env::var(LINK_TOKEN_VARIABLE).ok(),
            web_api: WebApiPlace::from_environment()?.of(address),
            own_link_port: None,
            local_udp: LocalUdp::default(),
        })
    }
}

/// Location of X-Plane 12's Web API.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum WebApiPlace {
    /// X-Plane's default: on its own computer only, so it is tried only if that is this one.
    #[default]
    Usual,
    /// Nowhere.
    Off,
    /// There.
    At(SocketAddr),
}

impl WebApiPlace {
    /// The value of [`WEB_API_VARIABLE`].
    ///
    /// # Errors
    /// [`BridgeError::BadVariable`] if it is neither `off` nor an address. Host names are resolved here.
    pub fn from_environment() -> Result<Self, BridgeError> {
        Self::of_variable(env::var(WEB_API_VARIABLE))
    }

    /// Parses the variable; if it is missing or empty, the default is used.
    fn of_variable(found: Result<String, VarError>) -> Result<Self, BridgeError> {
        let bad = |found: &str, why: BadWebApiPlace| {
            BridgeError::BadVariable(format!(
                "the environment variable {WEB_API_VARIABLE} is {found:?}: {why}"
            ))
        };
        match found {
            Err(VarError::NotPresent) => Ok(Self::Usual),
            Ok(text) if text.is_empty() => Ok(Self::Usual),
            Ok(text) => text.parse().map_err(|why| bad(&text, why)),
            Err(VarError::NotUnicode(bytes)) => Err(bad(
                &bytes.to_string_lossy(),
                BadWebApiPlace("it is not UTF-8 text".into()),
            )),
        }
    }

    /// The address to try for the simulator that takes UDP packets at `address`, if any.
    pub fn of(self, address: SocketAddr) -> Option<SocketAddr> {
        match self {
            Self::Usual => address
                .ip()
                .is_loopback()
                .then_some(web_api::DEFAULT_ADDRESS),
            Self::Off => None,
            Self::At(place) => Some(place),
        }
    }
}

const EXPECTED: &str = "expected HOST:PORT, e.g. 127.0.0.1:8086 or localhost:8086, or `off`";

/// Reason why a text is not a location of the Web API.
#[derive(Debug, thiserror::Error)]
#[error("{0}; {EXPECTED}")]
pub struct BadWebApiPlace(String);

impl FromStr for WebApiPlace {
    type Err = BadWebApiPlace;

    fn from_str(text: &str) -> Result<Self, BadWebApiPlace> {
        if text == "off" {
            return Ok(Self::Off);
        }
        let found: Vec<SocketAddr> = text
            .to_socket_addrs()
            .map_err(|error| BadWebApiPlace(error.to_string()))?
            .collect();
        // X-Plane serves it on IPv4 only, and `localhost` often resolves to an IPv6 address first.
        found
            .iter()
            .find(|address| address.is_ipv4())
            .or(found.first())
            .map(|&address| Self::At(address))
            .ok_or_else(|| BadWebApiPlace("it has no address".into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<WebApiPlace, BridgeError> {
        WebApiPlace::of_variable(Ok(text.to_owned()))
    }

    #[test]
    fn an_address_may_be_a_name_and_the_one_of_ipv4_is_taken() {
        let place = SocketAddr::from(([127, 0, 0, 1], 8_099));
        for text in ["127.0.0.1:8099", "localhost:8099"] {
            assert_eq!(of(text).unwrap(), WebApiPlace::At(place), "{text}");
        }
        assert_eq!(of("off").unwrap(), WebApiPlace::Off);
    }

    #[test]
    fn what_is_no_address_is_an_error_that_names_the_variable_what_it_is_and_what_it_should_be() {
        for text in [
            "nonsense",
            "localhost",
            "127.0.0.1",
            "127.0.0.1:http",
            "Off",
        ] {
            let said = of(text).unwrap_err().to_string();
            for word in ["DTD_WEB_API", &format!("{text:?}"), "HOST:PORT", "`off`"] {
                assert!(said.contains(word), "{text}: {said}");
            }
        }
    }

    #[test]
    fn without_the_variable_it_is_looked_for_on_this_computer_only() {
        let here = SocketAddr::from(([127, 0, 0, 1], 49_000));
        let elsewhere = SocketAddr::from(([10, 0, 0, 5], 49_000));
        let named = SocketAddr::from(([10, 0, 0, 5], 8_086));
        for unset in [Err(VarError::NotPresent), Ok(String::new())] {
            let usual = WebApiPlace::of_variable(unset).unwrap();
            assert_eq!(usual.of(here), Some(web_api::DEFAULT_ADDRESS));
            assert_eq!(usual.of(elsewhere), None);
        }
        assert_eq!(WebApiPlace::Off.of(here), None);
        assert_eq!(WebApiPlace::At(named).of(here), Some(named));
    }
}
