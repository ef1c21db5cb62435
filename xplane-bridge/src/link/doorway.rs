//! Accepts TCP clients: a few at a time, and a failing client does not end the server.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::sleep;

/// Delay after a client could not be accepted: others must first release the scarce resource, descriptors or memory.
const PAUSE: Duration = Duration::from_millis(100);

/// Accepts clients as long as there is space; the others wait in the system's queue.
#[derive(Debug)]
pub struct Doorway {
    what: &'static str,
    room: Arc<Semaphore>,
}

/// A client's place; it is free again when this is dropped.
#[derive(Debug)]
pub struct Room {
    _permit: Option<OwnedSemaphorePermit>,
}

impl Doorway {
    /// For at most `most` clients of `what`, which is named in the log.
    pub fn new(what: &'static str, most: usize) -> Self {
        Self {
            what,
            room: Arc::new(Semaphore::new(most)),
        }
    }

    /// The next client. Loses none when it is cancelled.
    pub async fn next(&self, listener: &TcpListener) -> (TcpStream, SocketAddr, Room) {
        // The semaphore is never closed; without a permit the client would only not be counted.
        let permit = self.room.clone().acquire_owned().await.ok();
        let mut failed_before = false;
        loop {
            match listener.accept().await {
                Ok((stream, from)) => return (stream, from, Room { _permit: permit }),
                Err(error) if failed_before => tracing::debug!(%error, "{}", self.what),
                Err(error) => {
                    failed_before = true;
                    tracing::warn!(%error, "{} can take no client now; it tries on", self.what);
                }
            }
            sleep(PAUSE).await;
        }
    }

    /// Room for a client that was accepted elsewhere, if there is any.
    pub fn room(&self) -> Option<Room> {
        let permit = self.room.clone().try_acquire_owned().ok()?;
        Some(Room {
            _permit: Some(permit),
        })
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncReadExt;
    use tokio::time::timeout;

    use super::*;

    #[tokio::test]
    async fn a_client_too_many_waits_until_another_one_leaves() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let doorway = Doorway::new("the test", 2);
        let mut clients = Vec::new();
        for _ in 0..3 {
            clients.push(TcpStream::connect(address).await.unwrap());
        }
        let first = doorway.next(&listener).await;
        let _second = doorway.next(&listener).await;
        assert!(doorway.room().is_none());
        let next = doorway.next(&listener);
        tokio::pin!(next);
        // Polled once, it finds no space although a client waits.
        assert!(timeout(Duration::ZERO, &mut next).await.is_err());
        let first_from = first.1;
        drop(first);
        assert_ne!(next.await.1, first_from);
        assert_eq!(clients[0].read(&mut [0]).await.unwrap(), 0);
    }
}
