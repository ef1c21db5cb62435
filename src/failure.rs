//! Exit codes of the command, for shell scripts and schedulers.

use std::fmt::Display;
use std::process::ExitCode;

use generator::sweep::SweepError;

/// Everything was done.
const DONE: u8 = 0;
/// The work could not be done.
pub(crate) const FAILED: u8 = 1;
/// The arguments or an input file are wrong: the same call will fail again.
const BAD_INPUT: u8 = 2;
/// Done, except for some scenarios, which were reported.
const LOSSES: u8 = 3;
/// Interrupted or disturbed from outside: the same call resumes.
pub(crate) const TRY_AGAIN: u8 = 75;

/// Ending of a successful verb.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// Complete.
    Done,
    /// Some scenarios were lost and reported.
    Losses,
    /// Stopped by a signal, without loss.
    Interrupted,
}

impl Ending {
    /// The ending of a verb that has these losses.
    pub(crate) fn with_losses<T>(losses: &[T]) -> Self {
        if losses.is_empty() {
            Self::Done
        } else {
            Self::Losses
        }
    }

    pub(crate) fn and(self, other: Self) -> Self {
        if self == Self::Done { other } else { self }
    }
}

/// A verb's failure.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The caller has to change something first.
    BadInput(anyhow::Error),
    /// The machine or another program is at fault.
    Failed(anyhow::Error),
    /// A temporary failure; the same call may work later.
    TryAgain(anyhow::Error),
    /// Stopped by a signal, without loss.
    Interrupted {
        /// True if the same call continues where this one stopped. Otherwise it starts over.
        resumes: bool,
    },
}

impl Failure {
    /// A failure caused by the caller's input, unless a disk that is full or broken is behind it.
    pub(crate) fn bad_input(error: impl Into<anyhow::Error>) -> Self {
        let error = error.into();
        let cause = match error.downcast_ref() {
            Some(SweepError::Unreadable(cause)) => Some(cause),
            _ => error.downcast_ref(),
        };
        if cause.is_some_and(dataset::Error::is_of_disk) {
            Self::Failed(error)
        } else {
            Self::BadInput(error)
        }
    }

    /// A failure caused by the caller's input if `is_bad_input`, otherwise by the machine.
    pub(crate) fn bad_input_if(is_bad_input: bool, error: impl Into<anyhow::Error>) -> Self {
        if is_bad_input {
            Self::bad_input(error)
        } else {
            Self::from(error)
        }
    }

    /// A corpus that cannot be read or written: the caller must fix it, it is locked by a process, or the machine failed.
    pub(crate) fn of_corpus(error: dataset::Error) -> Self {
        match error {
            error if error.is_passing() => Self::TryAgain(error.into()),
            error if error.is_bad_content() => Self::bad_input(error),
            error => Self::Failed(error.into()),
        }
    }

    /// This failure for a verb that starts over after an interruption.
    pub(crate) fn without_results(self) -> Self {
        match self {
            Self::Interrupted { .. } => Self::Interrupted { resumes: false },
            failure => failure,
        }
    }

    /// A failure caused by the caller's input, as text.
    pub(crate) fn bad_input_message(message: impl Display) -> Self {
        Self::BadInput(anyhow::anyhow!("{message}"))
    }
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        match error.downcast_ref::<dataset::Error>() {
            Some(cause) if cause.is_bad_content() => Self::bad_input(error),
            _ => Self::Failed(error),
        }
    }
}

/// Prints the failure to stderr and turns it into the process's exit code.
pub(crate) fn exit_code(result: Result<Ending, Failure>) -> ExitCode {
    let (code, error) = match result {
        Ok(Ending::Done) => (DONE, None),
        Ok(Ending::Losses) => (LOSSES, None),
        Ok(Ending::Interrupted) => (TRY_AGAIN, None),
        Err(Failure::BadInput(error)) => (BAD_INPUT, Some(error)),
        Err(Failure::Failed(error)) => (FAILED, Some(error)),
        Err(Failure::TryAgain(error)) => (TRY_AGAIN, Some(error)),
        Err(Failure::Interrupted { resumes }) => {
            eprintln!(
                "interrupted: {}",
                if resumes {
                    "run the same command again to resume"
                } else {
                    "there are no results; run the same command again"
                }
            );
            (TRY_AGAIN, None)
        }
    };
    if let Some(error) = error {
        eprint_error!("{error:#}");
    }
    ExitCode::from(code)
}

#[cfg(test)]
mod tests {
    use std::io;

    use rustix::io::Errno;

    use super::*;

    #[test]
    fn a_disk_that_is_full_is_no_bad_input() {
        let failure = |code| {
            let cause = io::Error::from_raw_os_error(code);
            Failure::bad_input(dataset::Error::io(
                "write",
                std::path::Path::new("plan.json"),
            )(cause))
        };
        for errno in [Errno::NOSPC, Errno::DQUOT, Errno::ROFS, Errno::IO] {
            assert!(
                matches!(failure(errno.raw_os_error()), Failure::Failed(_)),
                "{errno}"
            );
        }
        for errno in [Errno::NOTDIR, Errno::ACCESS] {
            assert!(
                matches!(failure(errno.raw_os_error()), Failure::BadInput(_)),
                "{errno}"
            );
        }
    }

    #[test]
    fn a_cause_is_said_once() {
        let cause = std::io::Error::other("the disk is on fire");
        let error = dataset::Error::io("read", std::path::Path::new("plan.json"))(cause);
        assert_eq!(
            format!("{:#}", anyhow::Error::from(error)),
            "cannot read plan.json: the disk is on fire"
        );
    }
}
