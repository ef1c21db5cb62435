//! `dtd generate`: the recorded scenarios of a sweep.

use std::env;
use std::path::Path;

use generator::generate::{
    Cancel, Event, GenerateOptions, Outcome as Generated, SimulatorTarget, generate as record,
};
use generator::sweep::Sweep;

use super::Outcome;
use super::async_runtime::async_runtime;
use super::output::print_json;
use crate::args::GenerateArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// Runs the verb.
pub(crate) fn run(args: &GenerateArgs) -> Outcome {
    let target = args.sim.parse().map_err(Failure::bad_input_message)?;
    let sweep = Sweep::read(&args.sweep).map_err(Failure::bad_input)?;
    let generated = generate(&sweep, &args.out, target, &args.only)?;
    if args.json {
        print_json(&generated)?;
    } else {
        println!(
            "{} scenarios made, {} whole already, {} failed: {}",
            generated.committed.len(),
            generated.skipped.len(),
            generated.failed.len(),
            args.out.display()
        );
    }
    Ok(ending_of(&generated))
}

/// How a run that ended so ends for the shell.
pub(crate) fn ending_of(generated: &Generated) -> Ending {
    if generated.interrupted {
        Ending::Interrupted
    } else if generated.failed.is_empty() {
        Ending::Done
    } else {
        Ending::Losses
    }
}

/// Makes the scenarios of a sweep with a progress bar. Ctrl-C ends it after the current pictures; nothing is lost.
pub(crate) fn generate(
    sweep: &Sweep,
    corpus: &Path,
    target: SimulatorTarget,
    only: &[String],
) -> Result<Generated, Failure> {
    let options = GenerateOptions {
        target,
        stand_in_program: env::current_exe()?,
        only: only.to_vec(),
    };
    let mut show = ShowEvents::new();
    let result = async_runtime()?.block_on(async {
        let cancel = Cancel::default();
        let on_signal = cancel.clone();
        tokio::spawn(async move {
            if tokio::signal::ctrl_c().await.is_ok() {
                on_signal.cancel();
            }
        });
        record(sweep, corpus, &options, &cancel, &mut |event| {
            show.take(event);
        })
        .await
    });
    result.map_err(|error| {
        if error.is_bad_input() {
            Failure::bad_input(error)
        } else {
            error.into()
        }
    })
}

/// Turns the generator's events into a bar and lines.
struct ShowEvents {
    bar: Bar,
    /// Ticks of the scenarios before the current one.
    before: u64,
    /// Ticks of all scenarios: planned ones for those to come, since a live flight takes as long as it takes.
    total: u64,
    /// Ticks of the current scenario, as far as they are known.
    planned: u64,
}

impl ShowEvents {
    fn new() -> Self {
        Self {
            bar: Bar::new("generate", "ticks", None),
            before: 0,
            total: 0,
            planned: 0,
        }
    }

    fn take(&mut self, event: Event<'_>) {
        match event {
            Event::Planned {
                to_make,
                skipped,
                ticks,
            } => {
                self.total = ticks;
                self.bar.set_total(ticks);
                if skipped > 0 {
                    self.bar.say(&format!(
                        "{skipped} scenarios are whole already, {to_make} to make"
                    ));
                }
            }
            Event::Started { id, ticks } => {
                self.planned = u64::from(ticks);
                self.bar.working_on(id);
            }
            Event::Flown { ticks } => {
                self.total = self.total + u64::from(ticks) - self.planned.min(self.total);
                self.planned = u64::from(ticks);
                self.bar.set_total(self.total);
            }
            Event::Captured { done } => self.bar.set_done(self.before + u64::from(done)),
            Event::Committed { id, ticks, seconds } => {
                self.before += u64::from(ticks);
                self.bar
                    .say(&format!("{id}: {ticks} ticks in {seconds:.0} s"));
            }
            Event::Retrying { id, reason } => {
                self.bar.set_done(self.before);
                self.bar
                    .say(&format!("{id} failed and is tried again: {reason}"));
            }
            Event::Failed { id, reason } => {
                self.before += self.planned;
                self.bar.say(&format!("{id} failed: {reason}"));
            }
        }
    }
}
