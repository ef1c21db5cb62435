//! The proxy of the capture link: greetings pass as they are, then whole messages in both directions.

use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::Route;
use crate::link::LinkError;
use crate::tape::error::TapeError;
use crate::tape::format::{Channel, Direction, LINK_VERSION_KEY};
use crate::tape::link_message::{LinkMessage, MAGIC};

/// Bytes of a greeting: four letters, the version.
const GREETING: usize = 8;

/// Serves until dropped.
pub(super) async fn run(listener: TcpListener, route: Arc<Route>) -> Result<(), TapeError> {
    let mut connections = JoinSet::new();
    let mut count = 0;
    loop {
        tokio::select! {
            accepted = listener.accept() => {
                let (client, from) = accepted.map_err(|source| TapeError::Socket {
                    what: "the recorder's capture link",
                    source,
                })?;
                count += 1;
                let connection = Connection { number: count, route: route.clone() };
                connections.spawn(async move {
                    match connection.serve(client, from).await {
                        Ok(()) => tracing::info!(%from, "capture link closed"),
                        Err(error) => tracing::warn!(%from, %error, "capture link closed"),
                    }
                });
            }
            Some(_) = connections.join_next() => {}
        }
    }
}

struct Connection {
    number: u32,
    route: Arc<Route>,
}

impl Connection {
    async fn serve(&self, client: TcpStream, from: SocketAddr) -> Result<(), LinkError> {
        let Some(address) = self.route.simulators_link() else {
            tracing::warn!(
                "a client comes before anybody has asked for {}: where the simulator's link is, is not known",
                crate::datarefs::CAPTURE_PORT
            );
            return Ok(());
        };
        let simulator = TcpStream::connect(address).await?;
        client.set_nodelay(true)?;
        simulator.set_nodelay(true)?;
        let (mut client_reads, mut client_writes) = client.into_split();
        let (mut simulator_reads, mut simulator_writes) = simulator.into_split();
        let (version, _) = tokio::try_join!(
            pass_greeting(&mut simulator_reads, &mut client_writes),
            pass_greeting(&mut client_reads, &mut simulator_writes),
        )?;
        for direction in [Direction::ToSimulator, Direction::FromSimulator] {
            let channel = self.channel(direction);
            let about = [
                ("client", from.to_string()),
                (LINK_VERSION_KEY, version.to_string()),
            ];
            self.route.deck.add_channel(channel, &about).await;
        }
        tracing::info!(%from, number = self.number, version, "capture link");
        // When the simulator has nothing more to say, the conversation is over; a client may stop asking before that.
        let requests = async {
            self.pass(Direction::ToSimulator, client_reads, simulator_writes)
                .await?;
            std::future::pending().await
        };
        tokio::select! {
            ended = self.pass(Direction::FromSimulator, simulator_reads, client_writes) => ended,
            failed = requests => failed,
        }
    }

    async fn pass(
        &self,
        direction: Direction,
        mut reads: OwnedReadHalf,
        mut writes: OwnedWriteHalf,
    ) -> Result<(), LinkError> {
        while let Some(message) = LinkMessage::read(&mut reads).await? {
            self.route
                .deck
                .link_message(self.number, direction, &message)
                .await;
            writes.write_all(message.bytes()).await?;
        }
        writes.shutdown().await?;
        Ok(())
    }

    fn channel(&self, direction: Direction) -> Channel {
        Channel::Link {
            connection: self.number,
            direction,
            reference: false,
        }
    }
}

/// Passes a greeting on and returns the version in it.
async fn pass_greeting(
    reads: &mut (impl AsyncReadExt + Unpin),
    writes: &mut (impl AsyncWriteExt + Unpin),
) -> Result<u32, LinkError> {
    let mut greeting = [0; GREETING];
    reads.read_exact(&mut greeting).await?;
    let [m0, m1, m2, m3, v0, v1, v2, v3] = greeting;
    let found = [m0, m1, m2, m3];
    if found != MAGIC {
        return Err(LinkError::NotTheLink { found });
    }
    writes.write_all(&greeting).await?;
    Ok(u32::from_le_bytes([v0, v1, v2, v3]))
}
