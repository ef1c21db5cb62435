//! Faults of the stand-in's process: a slow start, ports that are still held after the end, and a question after an end that was none.
//!
//! Reported of X-Plane: five minutes until it answers (PilotsDeck 167), a process that lives for 180 s after its end with its ports, and a
//! question whether to start in safe mode after an unclean one (CatfishW/xplane12api).

use std::fmt;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

/// Faults of the start and the end of the process.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LifeFaults {
    /// Nothing answers for so long after each start.
    pub cold: Duration,
    /// The ports stay taken for so long after the simulator was told to end.
    pub held: Duration,
    /// It starts in its main menu, where no plugin runs, until the Web API starts a flight.
    pub menu: bool,
    /// A file that exists while the simulator runs, and after an unclean end. If it is there at a start, the simulator asks whether to
    /// start in safe mode, and answers nothing; it ends only by a signal, which counts as an answer.
    pub asks: Option<PathBuf>,
}

/// The file of a simulator that runs; removed at a clean end.
#[derive(Debug)]
pub struct Running(Option<PathBuf>);

impl LifeFaults {
    /// Begins: a guard for the whole run, and true if the last end was unclean.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn begin(&self) -> io::Result<(Running, bool)> {
        let was_unclean = self.asks.as_ref().is_some_and(|file| file.exists());
        if let Some(file) = &self.asks {
            fs::write(file, "")?;
        }
        Ok((Running(self.asks.clone()), was_unclean))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(file) = &self.0
            && let Err(error) = fs::remove_file(file)
        {
            tracing::warn!(file = %file.display(), %error, "the end was clean, but its file stays");
        }
    }
}

impl fmt::Display for LifeFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (word, time) in [("cold", self.cold), ("held", self.held)] {
            if !time.is_zero() {
                write!(f, ",{word}={}", time.as_secs_f64())?;
            }
        }
        if self.menu {
            write!(f, ",menu=yes")?;
        }
        match &self.asks {
            Some(file) => write!(f, ",asks={}", file.display()),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_without_a_goodbye_is_asked_about_at_the_next_start_only() {
        let folder = tempfile::tempdir().unwrap();
        let life = LifeFaults {
            asks: Some(folder.path().join("runs")),
            ..LifeFaults::default()
        };
        let (killed, was_unclean) = life.begin().unwrap();
        assert!(!was_unclean);
        std::mem::forget(killed);
        let (asking, was_unclean) = life.begin().unwrap();
        assert!(was_unclean);
        drop(asking);
        assert!(!life.begin().unwrap().1);
    }
}
