//! The packets in `golden/`, which Python packed (`golden/make.py`), decode to the same meaning here.

use std::fmt::Debug;
use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde_json::Value;
use xplane_bridge::link::{Answer, Request, read_header};
use xplane_bridge::packet::{FromSimulator, PacketError, ToSimulator};

struct Golden {
    name: String,
    bytes: Vec<u8>,
    meaning: Value,
}

fn golden(direction: &str) -> Vec<Golden> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden");
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path
            .extension()
            .is_some_and(|extension| extension == "json")
        {
            let meaning: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            if meaning["direction"] == direction {
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                let bytes = std::fs::read(path.with_extension("bin")).unwrap();
                found.push(Golden {
                    name,
                    bytes,
                    meaning,
                });
            }
        }
    }
    assert!(
        !found.is_empty(),
        "no golden packets {direction} in {}",
        folder.display()
    );
    found
}

/// Checks that all packets of a direction decode to their meaning, and encode back if they are in the form that we send.
fn assert_packets<P: DeserializeOwned + PartialEq + Debug>(
    direction: &str,
    decode: impl Fn(&[u8]) -> Result<P, PacketError>,
    encode: impl Fn(&P) -> Result<Vec<u8>, PacketError>,
) {
    for Golden {
        name,
        bytes,
        meaning,
    } in golden(direction)
    {
        let wanted: P = serde_json::from_value(meaning["packet"].clone()).unwrap();
        if meaning["encodes_back"] == true {
            assert_eq!(encode(&wanted).unwrap(), bytes, "{name}");
        }
        assert_eq!(decode(&bytes), Ok(wanted), "{name}");
    }
}

#[test]
fn packets_decode_to_their_meaning_and_encode_back() {
    assert_packets("to_simulator", ToSimulator::decode, ToSimulator::encode);
    assert_packets(
        "from_simulator",
        FromSimulator::decode,
        FromSimulator::encode,
    );
}

#[tokio::test]
async fn messages_of_the_capture_link_are_read_as_the_plugin_would_pack_them() {
    for Golden {
        name,
        bytes,
        meaning,
    } in golden("capture_link")
    {
        let wanted = &meaning["packet"]["header"];
        let stream = &mut bytes.as_slice();
        let (found, payload) = match serde_json::from_value::<Request>(wanted.clone()) {
            Ok(_) => {
                let (header, payload) = read_header::<Request>(stream).await.unwrap().unwrap();
                (serde_json::to_value(header).unwrap(), payload)
            }
            Err(_) => {
                let (header, payload) = read_header::<Answer>(stream).await.unwrap().unwrap();
                (serde_json::to_value(header).unwrap(), payload)
            }
        };
        assert_eq!(&found, wanted, "{name}");
        assert_eq!(meaning["packet"]["payload_bytes"], payload, "{name}");
        assert_eq!(stream.len(), payload, "{name}");
    }
}
