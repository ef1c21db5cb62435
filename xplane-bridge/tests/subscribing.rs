//! Datarefs stay subscribed although datagrams get lost and the simulator forgets.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout, timeout_at};
use xplane_bridge::packet::{DatarefValue, DatarefValues, FromSimulator, ToSimulator};
use xplane_bridge::udp::subscription::{SILENCE, Subscription};

/// Takes requests until none comes for a while; the newest of each index.
async fn requests(socket: &UdpSocket) -> (BTreeMap<i32, bool>, Option<std::net::SocketAddr>) {
    let mut buffer = [0; 2048];
    let (mut found, mut client) = (BTreeMap::new(), None);
    while let Ok(received) =
        timeout(Duration::from_millis(250), socket.recv_from(&mut buffer)).await
    {
        let (length, from) = received.unwrap();
        if let Ok(ToSimulator::SubscribeDataref(request)) = ToSimulator::decode(&buffer[..length]) {
            found.insert(request.index, request.is_end());
            client = Some(from);
        }
    }
    (found, client)
}

#[tokio::test]
async fn a_simulator_that_forgets_is_asked_anew_and_one_that_is_left_is_told() {
    let simulator = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let names = (0..120).map(|i| format!("sim/test/{i}"));
    let mut subscription = Subscription::start(simulator.local_addr().unwrap(), names, 5)
        .await
        .unwrap();
    let (asked, client) = requests(&simulator).await;
    assert_eq!(asked.len(), 120);
    let values: Vec<DatarefValue> = asked
        .keys()
        .map(|&index| DatarefValue {
            index,
            value: index as f32,
        })
        .collect();
    let reply = FromSimulator::DatarefValues(DatarefValues { values });
    simulator
        .send_to(&reply.encode().unwrap(), client.unwrap())
        .await
        .unwrap();
    timeout(Duration::from_secs(2), subscription.changed())
        .await
        .unwrap();
    assert!(subscription.readings().iter().all(Option::is_some));
    // Requests repeated before the answer came are done; then all is quiet until the silence is noticed.
    while timeout(Duration::from_millis(100), simulator.recv(&mut [0; 2048]))
        .await
        .is_ok()
    {}
    let answered = Instant::now();
    let mut buffer = [0; 2048];
    let again = timeout_at(answered + SILENCE * 2, simulator.recv(&mut buffer)).await;
    assert!(again.is_ok(), "never asked again");
    assert!(
        answered.elapsed() > SILENCE / 2,
        "asked again after {:?}",
        answered.elapsed()
    );

    // Repeated requests would fill the socket's buffer, and the ends be lost.
    requests(&simulator).await;
    subscription.end().await;
    let (last, _) = requests(&simulator).await;
    assert_eq!(last.len(), 120);
    assert!(last.values().all(|&is_end| is_end));
}
