//! One thread per view that encodes images to a video, after its camera's own stream if there is one.
//!
//! The number of waiting images is limited: if an encoder is slower than the simulator, the simulator waits, and memory stays constant.
//! Buffers of written images are reused, unless they belong to a pool.

use std::sync::Arc;

use dataset::corpus::ScenarioFolder;
use dataset::geometry::imaging::Stream;
use dataset::plan::Picture;
use dataset::video::{CameraStream, VideoSettings, VideoWriter};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::task::{JoinHandle, spawn_blocking};
use xplane_bridge::link::PictureBytes;

use crate::generate::error::ScenarioError;

/// Encoders for one scenario. If they are dropped without [`Encoders::finish`], they stop and leave unfinished files.
pub(crate) struct Encoders {
    views: Vec<Encoder>,
    /// Slots for waiting images, shared by all views.
    room: Arc<Semaphore>,
    written: mpsc::UnboundedReceiver<PictureBytes>,
}

struct Encoder {
    view: String,
    pictures: mpsc::UnboundedSender<Message>,
    thread: JoinHandle<dataset::Result<Vec<i64>>>,
}

enum Message {
    /// Image with its slot.
    Picture(PictureBytes, OwnedSemaphorePermit),
    Finish,
}

impl Encoders {
    /// Starts an encoder per view, after its camera's stream. At most `waiting_pictures` images wait, all views together.
    pub(crate) fn start<'a>(
        folder: &ScenarioFolder,
        views: impl IntoIterator<Item = (&'a str, Option<Stream>)>,
        picture: Picture,
        settings: &VideoSettings,
        waiting_pictures: usize,
    ) -> Self {
        let (give_back, written) = mpsc::unbounded_channel();
        let start = |(view, stream): (&str, Option<Stream>)| {
            let (pictures, inbox) = mpsc::unbounded_channel();
            let path = folder.video_path(view);
            let settings = settings.clone();
            let give_back = give_back.clone();
            let thread = spawn_blocking(move || {
                let Picture {
                    width_px,
                    height_px,
                    frame_rate,
                } = picture;
                let writer =
                    VideoWriter::create(&path, &settings, width_px, height_px, frame_rate)?;
                let new_stream =
                    |stream| CameraStream::new(&path, stream, width_px, height_px, frame_rate);
                let stream = stream.map(new_stream).transpose()?;
                encode(writer, stream, inbox, &give_back)
            });
            Encoder {
                view: view.to_owned(),
                pictures,
                thread,
            }
        };
        Self {
            views: views.into_iter().map(start).collect(),
            room: Arc::new(Semaphore::new(waiting_pictures)),
            written,
        }
    }

    /// Sends a view's next image; waits while the encoder is behind.
    ///
    /// # Errors
    /// The encoder has ended; [`Encoders::abandon`] returns the reason.
    pub(crate) async fn write(
        &mut self,
        view: usize,
        rgb: PictureBytes,
    ) -> Result<(), ScenarioError> {
        let encoder = &self.views[view];
        let ended = || ScenarioError::EncoderEnded {
            view: encoder.view.clone(),
        };
        let place = self.room.clone().acquire_owned().await;
        let picture = Message::Picture(rgb, place.map_err(|_| ended())?);
        encoder.pictures.send(picture).map_err(|_| ended())
    }

    /// Buffer of a written image.
    pub(crate) fn take_written(&mut self) -> Option<PictureBytes> {
        self.written.try_recv().ok()
    }

    /// Completes all videos and returns the timestamps of each view.
    pub(crate) async fn finish(self) -> Result<Vec<Vec<i64>>, ScenarioError> {
        let mut all = Vec::new();
        for encoder in &self.views {
            // If the thread has ended, joining it gives the reason.
            let _ = encoder.pictures.send(Message::Finish);
        }
        // All are joined before the first failure is returned: no thread may write into the folder afterwards.
        for encoder in self.views {
            all.push(joined(&encoder.view, encoder.thread.await));
        }
        all.into_iter().collect()
    }

    /// Stops and joins all threads, so that no thread writes into the folder any more. Returns the first encoder failure, which is the
    /// reason if an encoder ended the scenario.
    pub(crate) async fn abandon(self) -> Option<ScenarioError> {
        let mut first = None;
        for Encoder {
            view,
            pictures,
            thread,
        } in self.views
        {
            drop(pictures);
            first = first.or(joined(&view, thread.await).err());
        }
        first
    }
}

fn joined(
    view: &str,
    result: Result<dataset::Result<Vec<i64>>, tokio::task::JoinError>,
) -> Result<Vec<i64>, ScenarioError> {
    let panicked = ScenarioError::panicked(format!("encoding view {view}"));
    Ok(result.map_err(panicked)??)
}

/// Thread body. Without a [`Message::Finish`] the scenario was abandoned, and the file is not completed.
fn encode(
    mut writer: VideoWriter,
    mut stream: Option<CameraStream>,
    mut inbox: mpsc::UnboundedReceiver<Message>,
    give_back: &mpsc::UnboundedSender<PictureBytes>,
) -> dataset::Result<Vec<i64>> {
    let mut pts = Vec::new();
    let mut received = Vec::new();
    while let Some(message) = inbox.blocking_recv() {
        match message {
            Message::Picture(rgb, _place) => {
                let recorded = match &mut stream {
                    None => &rgb[..],
                    Some(stream) => {
                        stream.pass(&rgb, &mut received)?;
                        &received[..]
                    }
                };
                pts.push(writer.write(recorded)?);
                // Pooled memory is returned on drop.
                if !matches!(rgb, PictureBytes::Pooled(_)) {
                    // The receiver is gone if the scenario is ending.
                    let _ = give_back.send(rgb);
                }
            }
            Message::Finish => {
                writer.finish()?;
                return Ok(pts);
            }
        }
    }
    Ok(pts)
}

#[cfg(test)]
mod tests {
    use dataset::corpus::Corpus;
    use dataset::numbers::frame_rate::FrameRate;

    use super::*;

    const SMALL: Picture = Picture {
        width_px: 64,
        height_px: 32,
        frame_rate: FrameRate {
            numerator: 30,
            denominator: 1,
        },
    };

    /// Two encoders; a folder is in the way of the second one's file.
    fn start(folder: &std::path::Path, has: &str) -> Encoders {
        let scenario = Corpus::create(folder).unwrap().scenario("a");
        std::fs::create_dir_all(scenario.root().join(has)).unwrap();
        Encoders::start(
            &scenario,
            [("left", None), ("right", Some(Stream { mbit_per_s: 4.0 }))],
            SMALL,
            &VideoSettings::default(),
            2,
        )
    }

    /// Writes black images, one view after the other, until an encoder fails or `ticks` images are written.
    async fn write(encoders: &mut Encoders, ticks: u32) -> Result<(), ScenarioError> {
        for _ in 0..ticks {
            for view in 0..2 {
                encoders.write(view, vec![0; 64 * 32 * 3].into()).await?;
            }
        }
        Ok(())
    }

    #[tokio::test]
    async fn an_encoder_that_cannot_write_ends_the_scenario_with_the_file_and_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let mut encoders = start(folder.path(), "not-views");
        let refused = write(&mut encoders, 1_000).await.unwrap_err();
        assert!(
            matches!(&refused, ScenarioError::EncoderEnded { .. }),
            "{refused}"
        );
        let reason = encoders.abandon().await.unwrap().to_string();
        assert!(
            reason.contains("left") && reason.contains("No such file"),
            "{reason}"
        );
    }

    #[tokio::test]
    async fn encoders_that_were_stopped_in_good_order_have_no_failure_to_tell() {
        let folder = tempfile::tempdir().unwrap();
        let mut encoders = start(folder.path(), "views");
        write(&mut encoders, 3).await.unwrap();
        assert!(encoders.abandon().await.is_none());
    }
}
