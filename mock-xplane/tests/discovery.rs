//! A stand-in that announces itself is found by its beacon.

use std::time::Duration;

use mock_xplane::server::{ServerOptions, serve};
use xplane_bridge::discovery::announced;

#[tokio::test]
async fn a_stand_in_on_this_computer_is_found_with_its_port_and_version() {
    let (tell, told) = tokio::sync::oneshot::channel();
    let options = ServerOptions {
        port: 0,
        ..ServerOptions::default()
    };
    let server = tokio::spawn(serve(options, |addresses| {
        let _ = tell.send(addresses.udp);
    }));
    let address = told.await.unwrap();
    // Another one may run on this computer, so that the wanted one need not be the only one.
    let found = announced(Duration::from_millis(2_500)).await.unwrap();
    let this = found
        .iter()
        .find(|one| one.address.port() == address.port());
    let this = this.unwrap_or_else(|| panic!("{address} is not among {found:?}"));
    assert_eq!(this.address, address);
    assert_eq!((this.beacon.host, this.beacon.version), (1, 124_009));
    server.abort();
}
