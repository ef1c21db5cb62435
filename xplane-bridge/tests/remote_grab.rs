//! The screen grabbed by a remote plugin: requests, and invalid answers.

use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::spawn_blocking;
use xplane_bridge::link::{
    LinkError, ScreenAnswer, ScreenRequest, exchange_greetings, read_header, write_message,
};
use xplane_bridge::pixels::{PixelError, Rectangle, RemoteScreen, RgbPicture, Screen};

const PART: Rectangle = Rectangle {
    x_px: 3,
    y_px: 2,
    width_px: 4,
    height_px: 5,
};

fn grabbed(width_px: u32, height_px: u32) -> ScreenAnswer {
    ScreenAnswer::Grabbed {
        width_px,
        height_px,
    }
}

fn opened() -> ScreenAnswer {
    ScreenAnswer::ScreenOpened {
        width_px: 40,
        height_px: 30,
    }
}

fn refusal() -> ScreenAnswer {
    ScreenAnswer::Error {
        text: "the session is locked".into(),
    }
}

/// A plugin that gives these answers and payloads one after the other, and then closes; returns the requests.
async fn plugin(
    answers: Vec<(ScreenAnswer, Vec<u8>)>,
) -> (SocketAddr, tokio::task::JoinHandle<Vec<ScreenRequest>>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let asked = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        converse(&mut stream, answers).await.unwrap()
    });
    (address, asked)
}

async fn converse(
    stream: &mut TcpStream,
    answers: Vec<(ScreenAnswer, Vec<u8>)>,
) -> Result<Vec<ScreenRequest>, LinkError> {
    exchange_greetings(stream).await?;
    let mut asked = Vec::new();
    for (answer, payload) in answers {
        let Some((request, 0)) = read_header::<ScreenRequest>(stream).await? else {
            panic!("no request for {answer:?}");
        };
        asked.push(request);
        write_message(stream, &answer, &payload).await?;
    }
    // A connection closed with a request unread is reset, and the client would see the reset instead of the end.
    stream.shutdown().await?;
    while stream.read(&mut [0; 256]).await? > 0 {}
    Ok(asked)
}

/// Grabs a part several times.
async fn grab(
    link: SocketAddr,
    part: Option<Rectangle>,
    times: usize,
) -> Result<RgbPicture, PixelError> {
    let screen: Arc<dyn Screen> = Arc::new(RemoteScreen::new(link, Some("open sesame".into())));
    let grabbing = spawn_blocking(move || {
        let mut grab = screen.open(part)?;
        let mut picture = RgbPicture::default();
        for _ in 0..times {
            grab.grab(&mut picture)?;
        }
        Ok(picture)
    });
    grabbing.await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_token_and_the_part_are_told_and_the_picture_comes_as_it_was_sent() {
    let picture: Vec<u8> = (0..60).collect();
    let answers = vec![
        (opened(), Vec::new()),
        (grabbed(4, 5), vec![9; 60]),
        (grabbed(4, 5), picture.clone()),
    ];
    let (link, asked) = plugin(answers).await;
    let found = grab(link, Some(PART), 2).await.unwrap();
    assert_eq!(
        (found.width_px, found.height_px, found.rgb),
        (4, 5, picture)
    );
    let part = Rectangle {
        x_px: 3,
        y_px: 2,
        width_px: 4,
        height_px: 5,
    };
    let asked = asked.await.unwrap();
    assert!(
        matches!(&asked[0], ScreenRequest::OpenScreen { token: Some(token), .. } if token == "open sesame")
    );
    assert_eq!(asked[1], ScreenRequest::Grab { part: Some(part) });
    let text = serde_json::to_string(&asked[1]).unwrap();
    assert_eq!(
        text,
        r#"{"message":"grab","x_px":3,"y_px":2,"width_px":4,"height_px":5}"#
    );

    let answers = vec![(opened(), Vec::new()), (grabbed(40, 30), vec![1; 3_600])];
    let (link, asked) = plugin(answers).await;
    let whole = grab(link, None, 1).await.unwrap();
    assert_eq!((whole.width_px, whole.height_px), (40, 30));
    let text = serde_json::to_string(&asked.await.unwrap()[1]).unwrap();
    assert_eq!(text, r#"{"message":"grab"}"#);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refusal_and_what_is_no_picture_of_that_part_are_errors_that_say_so() {
    let open = || (opened(), Vec::new());
    for (answers, words) in [
        (vec![(refusal(), vec![])], "the session is locked"),
        (vec![(grabbed(4, 5), vec![0; 60])], "expected screen_opened"),
        (vec![open(), (refusal(), vec![])], "the session is locked"),
        (vec![open(), open()], "expected grabbed"),
        (vec![open(), (grabbed(5, 4), vec![0; 60])], "5x4 pixels"),
        (vec![open(), (grabbed(4, 5), vec![0; 59])], "59 bytes"),
        (vec![open()], "closed the connection"),
    ] {
        let (link, _asked) = plugin(answers).await;
        let text = grab(link, Some(PART), 1).await.unwrap_err().to_string();
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    // Sides whose product no payload has.
    let huge = vec![open(), (grabbed(u32::MAX, u32::MAX), vec![0; 12])];
    let (link, _asked) = plugin(huge).await;
    let text = grab(link, None, 1).await.unwrap_err().to_string();
    assert!(text.contains("12 bytes as 4294967295x4294967295"), "{text}");
}
