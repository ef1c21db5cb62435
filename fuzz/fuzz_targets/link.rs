//! Any bytes as the input of one side of the capture link; the first one selects the side. No panic, and a decoded message encodes
//! and decodes to the same.

#![no_main]

use std::io;
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};

use libfuzzer_sys::fuzz_target;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use xplane_bridge::link::{
    Answer, MAX_HEADER_BYTES, MAX_PAYLOAD_BYTES, Request, decode_flight, exchange_greetings,
    read_header, read_payload, read_request, write_message,
};
use xplane_tape::LinkMessage;

/// Of a message that is written.
const LENGTHS_BYTES: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let (direction, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    let mut peer = Peer(bytes);
    at_once(async {
        match direction % 4 {
            0 => drop(exchange_greetings(&mut peer).await),
            1 => requests(&mut peer).await,
            2 => answers(&mut peer).await,
            _ => {
                let mut passed = Vec::new();
                while let Ok(Some(message)) = LinkMessage::read(&mut peer).await {
                    let _ = message.token();
                    passed.extend(message.bytes());
                }
                assert!(bytes.starts_with(&passed));
            }
        }
    });
});

/// Input of the simulator's side. After an invalid header it reads on.
async fn requests(peer: &mut Peer<'_>) {
    use xplane_bridge::link::LinkError::BadHeader;
    loop {
        match read_request(peer).await {
            Ok(Some(request)) => {
                if let Request::Capture(capture) = &request
                    && capture.check().is_ok()
                {
                    assert!(capture.rgb_bytes() <= MAX_PAYLOAD_BYTES);
                }
                same_again(&request).await;
            }
            Err(BadHeader(_)) => {}
            Ok(None) | Err(_) => return,
        }
    }
}

/// Input of the client, with the payload of a flight decoded.
async fn answers(peer: &mut Peer<'_>) {
    let mut payload = Vec::new();
    while let Ok(Some((answer, payload_bytes))) = read_header::<Answer>(peer).await {
        same_again(&answer).await;
        // Space is allocated for an announced payload. Here that would only take time.
        if payload_bytes > peer.0.len() {
            return;
        }
        payload.clear();
        if read_payload(peer, payload_bytes, &mut payload)
            .await
            .is_err()
        {
            return;
        }
        if let Answer::Flown { columns, rows } = answer {
            drop(decode_flight(&columns, rows, &payload));
        }
    }
}

async fn same_again<M: Serialize + DeserializeOwned>(message: &M) {
    let mut sent = Vec::new();
    // Numbers may be longer than they came.
    if write_message(&mut sent, message, &[]).await.is_err() {
        return;
    }
    assert!(sent.len() <= LENGTHS_BYTES + MAX_HEADER_BYTES);
    let heard = read_header::<M>(&mut &sent[..]).await;
    let (heard, _) = heard.unwrap().unwrap();
    let mut again = Vec::new();
    write_message(&mut again, &heard, &[]).await.unwrap();
    assert_eq!(sent, again);
}

/// Runs futures that never wait.
fn at_once(work: impl Future<Output = ()>) {
    let mut context = Context::from_waker(Waker::noop());
    assert!(pin!(work).poll(&mut context).is_ready());
}

/// Sends these bytes and receives nothing.
struct Peer<'a>(&'a [u8]);

impl AsyncRead for Peer<'_> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().0).poll_read(context, buffer)
    }
}

impl AsyncWrite for Peer<'_> {
    fn poll_write(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
