//! The proxy of the capture link: greetings are forwarded unchanged, then whole messages in both directions.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt, copy};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;

use super::Route;
use crate::format::{Channel, Direction, LINK_VERSION_KEY, Traffic};
use crate::link_message::LinkMessage;
use doorway::Doorway;
use xplane_bridge::link::{Answer, LinkError, MAGIC, not_the_link, write_message};

/// Greeting length: four letters, the version.
const GREETING: usize = 8;

/// Connections at a time.
const MAX_CONNECTIONS: usize = 32;
/// Timeout of greetings and hello, on both sides together.
const HELLO_WITHIN: Duration = Duration::from_secs(5);

/// Serves until dropped.
pub(super) async fn run(listener: TcpListener, route: Arc<Route>) -> Infallible {
    let doorway = Doorway::new("the recorder's capture link", MAX_CONNECTIONS);
    let mut number = 0;
    let serve = |client, from| {
        number += 1;
        let route = route.clone();
        async move {
            match (Connection { number, route }).serve(client, from).await {
                Ok(()) => tracing::info!(%from, "capture link closed"),
                Err(error) => tracing::warn!(%from, %error, "capture link closed"),
            }
        }
    };
    doorway.serve(&listener, serve).await
}

struct Connection {
    number: u32,
    route: Arc<Route>,
}

/// Two sides that have exchanged greetings, and the client's first request.
struct Admitted {
    version: u32,
    hello: LinkMessage,
    client: (OwnedReadHalf, OwnedWriteHalf),
    simulator: (OwnedReadHalf, OwnedWriteHalf),
}

impl Connection {
    async fn serve(&self, client: TcpStream, from: SocketAddr) -> Result<(), LinkError> {
        let Some(address) = self.route.simulators_link() else {
            tracing::warn!(
                "a client comes before anybody has asked for {}: where the simulator's link is, is not known",
                xplane_bridge::datarefs::CAPTURE_PORT
            );
            return Ok(());
        };
        client.set_nodelay(true)?;
        let late = LinkError::ended("the time for a hello");
        let admitted = timeout(HELLO_WITHIN, self.admit(client, address)).await;
        let Some(admitted) = admitted.unwrap_or(Err(late))? else {
            return Ok(());
        };
        let Admitted {
            version,
            hello,
            client: (client_reads, mut client_writes),
            simulator: (simulator_reads, mut simulator_writes),
        } = admitted;
        if hello.opens_the_screen() {
            // The desktop's content is private to the client, but tapes are passed on.
            tracing::info!(%from, "images of the screen pass, and are not recorded");
            simulator_writes.write_all(hello.bytes()).await?;
            let (mut asks, mut answers) = (client_reads, simulator_reads);
            tokio::select! {
                ended = copy(&mut asks, &mut simulator_writes) => ended?,
                ended = copy(&mut answers, &mut client_writes) => ended?,
            };
            return Ok(());
        }
        for direction in [Direction::ToSimulator, Direction::FromSimulator] {
            let channel = self.channel(direction);
            let about = [
                ("client", from.to_string()),
                (LINK_VERSION_KEY, version.to_string()),
            ];
            self.route.tape_thread.add_channel(channel, &about).await;
        }
        tracing::info!(%from, number = self.number, version, "capture link");
        self.pass(Direction::ToSimulator, &hello, &mut simulator_writes)
            .await?;
        // When the simulator closes, the conversation is over; a client may stop sending before that.
        let requests = async {
            let mut reads = client_reads;
            while let Some(message) = LinkMessage::read_request(&mut reads).await? {
                self.pass(Direction::ToSimulator, &message, &mut simulator_writes)
                    .await?;
            }
            simulator_writes.shutdown().await?;
            std::future::pending().await
        };
        let answers = async {
            let mut reads = simulator_reads;
            while let Some(message) = LinkMessage::read(&mut reads).await? {
                self.pass(Direction::FromSimulator, &message, &mut client_writes)
                    .await?;
            }
            client_writes.shutdown().await?;
            Ok(())
        };
        tokio::select! {
            ended = answers => ended,
            failed = requests => failed,
        }
    }

    /// Exchanges greetings with both sides and reads the client's hello; `None` if it is rejected.
    async fn admit(
        &self,
        client: TcpStream,
        address: SocketAddr,
    ) -> Result<Option<Admitted>, LinkError> {
        let (mut client_reads, mut client_writes) = client.into_split();
        // Neither side waits for the other's greeting, so the client's arrives unrequested, and a client that sends none costs the
        // simulator no connection.
        let greeting = read_greeting(&mut client_reads).await?;
        let simulator = TcpStream::connect(address).await?;
        simulator.set_nodelay(true)?;
        let (mut simulator_reads, mut simulator_writes) = simulator.into_split();
        simulator_writes.write_all(&greeting).await?;
        let greeting = read_greeting(&mut simulator_reads).await?;
        client_writes.write_all(&greeting).await?;
        let [.., v0, v1, v2, v3] = greeting;
        let version = u32::from_le_bytes([v0, v1, v2, v3]);
        let Some(hello) = LinkMessage::read_request(&mut client_reads).await? else {
            return Ok(None);
        };
        if let Some(token) = &self.route.token
            && !token.is(hello.token().as_deref())
        {
            let text = "this recorder requires a token: set DTD_LINK_TOKEN to the same value on both sides";
            let answer = Answer::refusal(text);
            write_message(&mut client_writes, &answer, &[]).await?;
            return Ok(None);
        }
        Ok(Some(Admitted {
            version,
            hello,
            client: (client_reads, client_writes),
            simulator: (simulator_reads, simulator_writes),
        }))
    }

    /// Onto the tape, and then on.
    async fn pass(
        &self,
        direction: Direction,
        message: &LinkMessage,
        to: &mut OwnedWriteHalf,
    ) -> Result<(), LinkError> {
        self.route
            .tape_thread
            .write_message(self.channel(direction), message)
            .await;
        to.write_all(message.bytes()).await?;
        Ok(())
    }

    fn channel(&self, direction: Direction) -> Channel {
        Channel {
            traffic: Traffic::Link,
            number: self.number,
            direction,
        }
    }
}

/// A greeting, as far as it is one of the link.
async fn read_greeting(reads: &mut OwnedReadHalf) -> Result<[u8; GREETING], LinkError> {
    let mut greeting = [0; GREETING];
    reads.read_exact(&mut greeting).await?;
    let [m0, m1, m2, m3, ..] = greeting;
    match [m0, m1, m2, m3] {
        MAGIC => Ok(greeting),
        other => Err(not_the_link(other)),
    }
}
