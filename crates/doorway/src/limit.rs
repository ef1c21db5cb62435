//! Accepts TCP clients: a few at a time, and a failing client does not end the server.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinSet;
use tokio::time::sleep;

/// Delay after a client could not be accepted: others must first release the scarce resource, descriptors or memory.
const PAUSE: Duration = Duration::from_millis(100);

/// Accepts clients as long as there is space; the others wait in the system's queue.
#[derive(Debug)]
pub struct Doorway {
    what: &'static str,
    room: Arc<Semaphore>,
}

impl Doorway {
    /// For at most `most` clients of `what`, which is named in the log.
    pub fn new(what: &'static str, most: usize) -> Self {
        Self {
            what,
            room: Arc::new(Semaphore::new(most)),
        }
    }

    /// Serves clients until dropped, which ends all of them.
    pub async fn serve<S>(
        &self,
        listener: &TcpListener,
        mut serve: impl FnMut(TcpStream, SocketAddr) -> S,
    ) -> Infallible
    where
        S: Future<Output = ()> + Send + 'static,
    {
        let mut clients = JoinSet::new();
        loop {
            tokio::select! {
                (stream, from, room) = self.next(listener) => {
                    let served = serve(stream, from);
                    clients.spawn(async move {
                        let _room = room;
                        served.await;
                    });
                }
                Some(_) = clients.join_next() => {}
            }
        }
    }

    /// The next client, with its place, which is free again when it is dropped. Loses none when it is cancelled.
    pub async fn next(
        &self,
        listener: &TcpListener,
    ) -> (TcpStream, SocketAddr, Option<OwnedSemaphorePermit>) {
        // The semaphore is never closed; without a permit the client would only not be counted.
        let permit = self.room.clone().acquire_owned().await.ok();
        let mut failed_before = false;
        loop {
            match listener.accept().await {
                Ok((stream, from)) => return (stream, from, permit),
                Err(error) if failed_before => tracing::debug!(%error, "{}", self.what),
                Err(error) => {
                    failed_before = true;
                    tracing::warn!(%error, "{} can take no client now; it tries on", self.what);
                }
            }
            sleep(PAUSE).await;
        }
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
