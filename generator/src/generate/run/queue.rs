//! Selects the next scenario. Workers of this process and other processes take from one plan; claims separate them.

use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::plan::PlannedScenario;

use crate::generate::freeze::is_whole;

/// Polling interval when other processes hold everything that is left.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// A scenario that is not recorded yet.
#[derive(Debug)]
pub(crate) struct Task<'a> {
    pub(crate) scenario: &'a PlannedScenario,
    /// Reasons why earlier attempts of this run failed.
    pub(crate) reasons: Vec<String>,
    /// True if one of them failed by its images.
    pub(crate) images_failed: bool,
    /// Attempts that no simulator answered and that do not count.
    pub(crate) silences: u32,
    /// A failed attempt is retried after a delay.
    not_before: Option<Instant>,
}

/// The answer to a worker.
pub(crate) enum Next<'a> {
    /// This one; it is claimed, so other processes cannot record it.
    Make(Task<'a>, Claim),
    /// This one is complete in the corpus' folder already: a different process recorded it in the meantime.
    Whole(Task<'a>, Claim),
    /// Nothing to do now; a scenario may become available again.
    Later(Duration, Option<Elsewhere>),
    /// All are recorded or set aside.
    Finished,
}

/// The scenarios that other processes are recording.
pub(crate) struct Elsewhere {
    pub(crate) scenarios: usize,
    pub(crate) holder: String,
}

/// Waiting scenarios, in trial order.
#[derive(Debug)]
pub(crate) struct Queue<'a> {
    waiting: Vec<Task<'a>>,
    /// Held by this process's workers.
    in_hand: usize,
}

impl<'a> Queue<'a> {
    pub(crate) fn new(scenarios: &[&'a PlannedScenario]) -> Self {
        let task = |scenario: &&'a PlannedScenario| Task {
            scenario,
            reasons: Vec::new(),
            images_failed: false,
            silences: 0,
            not_before: None,
        };
        Self {
            waiting: scenarios.iter().map(task).collect(),
            in_hand: 0,
        }
    }

    /// The next scenario without a holder. The caller must return it or mark it as done.
    pub(crate) fn next(
        &mut self,
        corpus: &Corpus,
    ) -> Result<Next<'a>, crate::generate::GenerateError> {
        let now = Instant::now();
        let mut later = POLL_INTERVAL;
        let mut elsewhere: Option<Elsewhere> = None;
        for at in 0..self.waiting.len() {
            let task = &self.waiting[at];
            if let Some(wait) = task.not_before.and_then(|t| t.checked_duration_since(now))
                && !wait.is_zero()
            {
                later = later.min(wait);
                continue;
            }
            match Claim::take(corpus, &task.scenario.id)? {
                // Checked only now that no other process can commit it.
                Claimed::Mine(claim) if is_whole(corpus, task.scenario)? => {
                    self.in_hand += 1;
                    return Ok(Next::Whole(self.waiting.remove(at), claim));
                }
                Claimed::Mine(claim) => {
                    self.in_hand += 1;
                    return Ok(Next::Make(self.waiting.remove(at), claim));
                }
                Claimed::Theirs(holder) => {
                    let first = || Elsewhere {
                        scenarios: 0,
                        holder: holder.to_string(),
                    };
                    elsewhere.get_or_insert_with(first).scenarios += 1;
                }
            }
        }
        Ok(match (self.waiting.is_empty(), self.in_hand) {
            (true, 0) => Next::Finished,
            _ => Next::Later(later, elsewhere),
        })
    }

    /// Returns a scenario that failed, to be retried by any worker after a delay.
    pub(crate) fn give_back(&mut self, mut task: Task<'a>, pause: Duration) {
        self.in_hand -= 1;
        task.not_before = Some(Instant::now() + pause);
        self.waiting.push(task);
    }

    /// Marks a scenario as recorded or set aside.
    pub(crate) fn done_with(&mut self, _task: Task<'a>) {
        self.in_hand -= 1;
    }

    /// True if a worker may get one now or later.
    pub(crate) fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    pub(crate) fn left(&self) -> impl Iterator<Item = &'a PlannedScenario> {
        self.waiting.iter().map(|task| task.scenario)
    }
}
