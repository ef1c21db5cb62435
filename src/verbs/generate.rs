//! `dtd generate`: records the scenarios of a sweep.

use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use dataset::files::folder::bytes_below;
use generator::generate::{
    Event, GenerateError, GenerateOptions, Outcome as Generated, Patience, Remote, Restart,
    Simulators, Stopped, free_bytes, generate as record,
};
use generator::plan::{Outlook, expand};
use generator::sweep::Sweep;
use store::{CorpusLocation, CorpusStore};
use xplane_bridge::{LocalUdp, WebApiPlace};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{default_stage, failure_of};
use super::output::{Next, count, finish, interrupted, print_json};
use super::plan::warn;
use crate::args::recording::GenerateArgs;
use crate::failure::{Ending, Failure};
use crate::progress::{Bar, Disk, Scenarios};
use crate::signals::CleanStop;

/// Runs the verb.
pub(crate) fn run(args: &GenerateArgs) -> Outcome {
    let began = Instant::now();
    let sweep = Sweep::read(&args.sweep).map_err(Failure::bad_input)?;
    let plan = expand(&sweep);
    warn(&sweep, &plan, &Outlook::new(&sweep, &plan));
    let (corpus, remote) = place(args)?;
    let timeout = Duration::from_secs(args.timeout_s);
    let options = GenerateOptions {
        simulators: args.sim.clone(),
        local_udp: local_udp(args)?,
        pixels: args.pixels,
        only: args.only.clone(),
        shard: args.shard.or_of_environment("generate")?,
        patience: Patience {
            simulator: timeout,
            ..Patience::default()
        },
        restart: args.restart_simulator.clone().map(|command| Restart {
            command,
            every: args.restart_every,
        }),
        remote,
        ..options(args.sim.clone())?
    };
    let generated = generate(&sweep, &corpus, &options)?;
    if args.json {
        print_json(&generated)?;
    } else {
        println!(
            "{} made, {} complete already, {} failed{}: {}",
            count(generated.committed.len(), "scenario"),
            generated.skipped.len(),
            generated.failed.len(),
            [
                (generated.staged.len(), "made but not sent yet"),
                (generated.not_made.len(), "not made"),
            ]
            .map(|(number, what)| match number {
                0 => String::new(),
                number => format!(", {number} {what}"),
            })
            .concat(),
            match &args.out {
                CorpusLocation::Folder(folder) => folder.display().to_string(),
                CorpusLocation::Store(url) => url.to_string(),
            }
        );
        for marked in &generated.marked {
            println!("marked: {}: {}", marked.id, marked.differences.join("; "));
        }
        for failed in &generated.failed {
            println!("failed: {}: {}", failed.id, failed.reason);
        }
    }
    let ending = ending_of(&generated)?;
    if let (Ending::Done, CorpusLocation::Folder(folder)) = (&ending, &args.out) {
        finish("generate", began, &Next::verb("label", folder));
    }
    Ok(ending)
}

/// The local side of UDP. Each simulator that runs already needs a separate port.
fn local_udp(args: &GenerateArgs) -> Result<LocalUdp, Failure> {
    let running = args.sim.running_already();
    if let Some(port) = args.local_udp.udp_port {
        if running == 0 {
            return Err(Failure::bad_input_message(
                "--udp-port is for a simulator that runs already (--sim HOST:PORT or auto); the bundled simulators and tapes of this run take any port",
            ));
        }
        if usize::from(port) + running - 1 > usize::from(u16::MAX) {
            return Err(Failure::bad_input_message(format!(
                "--udp-port {port}: {running} simulators take as many ports from there on, but 65535 is the last one"
            )));
        }
    }
    Ok(args.local_udp.options())
}

/// The folder to record into, and where it is uploaded to.
fn place(args: &GenerateArgs) -> Result<(PathBuf, Option<Remote>), Failure> {
    match &args.out {
        CorpusLocation::Folder(_) if args.staging.is_some() || args.keep_staged => {
            Err(Failure::bad_input_message(
                "--staging and --keep-staged are for a corpus at a URL; this one is recorded where it stays",
            ))
        }
        CorpusLocation::Folder(folder) => Ok((folder.clone(), None)),
        CorpusLocation::Store(url) => {
            let stage = args.staging.clone().unwrap_or_else(|| default_stage(url));
            let remote = Remote {
                store: CorpusStore::open(url, true, Duration::from_secs(args.timeout_s))
                    .map_err(failure_of)?,
                keep_staged: args.keep_staged,
            };
            eprintln!(
                "generate: recording into {}, sending to {url}",
                stage.display()
            );
            Ok((stage, Some(remote)))
        }
    }
}

/// Options to record a whole sweep.
pub(crate) fn options(simulators: Simulators) -> Result<GenerateOptions, Failure> {
    Ok(GenerateOptions {
        stand_in_program: env::current_exe()?,
        ..GenerateOptions::new(simulators)
    })
}

/// The exit status of a run; prints the reason to stderr.
pub(crate) fn ending_of(generated: &Generated) -> Outcome {
    let (made, left) = (generated.committed.len(), generated.not_made.len());
    match &generated.stopped {
        Some(Stopped::Interrupted) if made == 0 && left == 0 => {
            eprintln!("interrupted before anything was made; run the same command again");
            Ok(Ending::Interrupted)
        }
        Some(Stopped::Interrupted) => Ok(interrupted(made, "made", left)),
        Some(Stopped::NoSimulator { reason }) => {
            eprint_warning!(
                "no simulator is left ({reason}): {made} made, {left} to go; run the same command again to resume"
            );
            Ok(Ending::Interrupted)
        }
        Some(Stopped::Setup { reason }) => {
            eprint_error!(
                "every scenario would fail ({reason}): {made} made, {left} to go; change this, and run the same command again to resume"
            );
            Ok(Ending::Losses)
        }
        Some(Stopped::Storage { reason } | Stopped::Store { reason }) => {
            Err(Failure::Failed(anyhow::anyhow!("{reason}")))
        }
        None if generated.failed.is_empty() && generated.marked.is_empty() => Ok(Ending::Done),
        None => Ok(Ending::Losses),
    }
}

/// Records the scenarios of a sweep with a progress bar. Ctrl-C or SIGTERM ends it after the current images, without loss.
pub(crate) fn generate(
    sweep: &Sweep,
    corpus: &Path,
    options: &GenerateOptions,
) -> Result<Generated, Failure> {
    // A simulator that cannot be reached is retried; a wrong variable stays wrong.
    WebApiPlace::from_environment().map_err(Failure::bad_input)?;
    let mut show = ShowEvents::new(corpus);
    let stop = CleanStop::begin();
    let stopping = stop.switch();
    let result =
        async_runtime()?.block_on(record(sweep, corpus, options, stopping, &mut |event| {
            show.take(event);
        }));
    drop(stop);
    match result {
        // Stopped before anything was started.
        Err(GenerateError::Cancelled) => Ok(Generated {
            stopped: Some(Stopped::Interrupted),
            ..Generated::default()
        }),
        Err(error) if error.is_bad_input() => Err(Failure::bad_input(error)),
        Err(error) if error.is_passing() => Err(Failure::TryAgain(error.into())),
        result => Ok(result?),
    }
}

/// Turns the generator's events into a bar and lines.
struct ShowEvents {
    bar: Bar,
    corpus: PathBuf,
    scenarios: Scenarios,
    /// Bytes of the scenarios that were committed.
    written: u64,
    /// Ticks of the scenarios in progress.
    before: u64,
    /// Ticks of all scenarios: planned numbers for the remaining ones, since live flights vary.
    total: u64,
    /// The scenarios in progress.
    current: BTreeMap<String, Current>,
}

/// Ticks of a scenario in progress.
struct Current {
    planned: u64,
    done: u64,
}

impl ShowEvents {
    fn new(corpus: &Path) -> Self {
        Self {
            bar: Bar::new("generate", "ticks", None),
            corpus: corpus.to_owned(),
            scenarios: Scenarios::default(),
            written: 0,
            before: 0,
            total: 0,
            current: BTreeMap::new(),
        }
    }

    fn show_done(&self) {
        let current: u64 = self.current.values().map(|current| current.done).sum();
        let done = self.before + current;
        // The last image is not the end: its scenario is sealed and committed first.
        let is_over = self.current.is_empty();
        self.bar.set_done(if is_over {
            done
        } else {
            done.min(self.total.saturating_sub(1))
        });
    }

    fn show_current(&self) {
        let names: Vec<&str> = self.current.keys().map(String::as_str).collect();
        self.bar.working_on(&names.join(" "));
    }

    /// A scenario that ended, with the ticks that count as done.
    fn ended(&mut self, id: &str, ticks: u64) {
        self.current.remove(id);
        self.before += ticks;
        self.show_done();
        self.show_current();
    }

    /// A scenario that was completed by a different process, or set aside.
    fn finished_without_us(&mut self, id: &str, ticks: u64) {
        self.bar.add_foreign(ticks);
        self.finished(id, ticks);
    }

    /// A scenario that is complete, or set aside.
    fn finished(&mut self, id: &str, ticks: u64) {
        self.scenarios.number = (self.scenarios.number + 1).min(self.scenarios.of);
        self.bar.set_scenarios(self.scenarios);
        self.bar.set_disk(Disk {
            written: self.written,
            free: free_bytes(&self.corpus),
        });
        self.ended(id, ticks);
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
                self.scenarios.of = skipped + to_make;
                self.scenarios.number = (skipped + 1).min(self.scenarios.of);
                self.bar.set_scenarios(self.scenarios);
                if skipped > 0 {
                    self.bar.say(&format!(
                        "{} complete already, {to_make} to make",
                        count(skipped, "scenario")
                    ));
                }
            }
            Event::Started { id, ticks } => {
                let planned = u64::from(ticks);
                self.current
                    .insert(id.to_owned(), Current { planned, done: 0 });
                self.show_current();
            }
            Event::Flown { id, ticks } => {
                if let Some(current) = self.current.get_mut(id) {
                    self.total = self.total + u64::from(ticks) - current.planned.min(self.total);
                    current.planned = u64::from(ticks);
                    self.bar.set_total(self.total);
                }
            }
            Event::Captured { id, done } => {
                if let Some(current) = self.current.get_mut(id) {
                    current.done = u64::from(done);
                }
                self.show_done();
            }
            Event::Committed { id, ticks, seconds } => {
                self.bar
                    .say(&format!("{id}: {ticks} ticks in {seconds:.0} s"));
                let folder = self.corpus.join("scenarios").join(id);
                self.written += bytes_below(&folder).unwrap_or(0);
                self.finished(id, u64::from(ticks));
            }
            Event::PaceChanged { id } => {
                if let Some(current) = self.current.get_mut(id) {
                    current.done = 0;
                }
                let others: u64 = self.current.values().map(|current| current.done).sum();
                self.bar.resume(self.before + others);
            }
            Event::MadeElsewhere { id, ticks } => {
                self.bar.say(&format!("{id}: made by another process"));
                self.finished_without_us(id, u64::from(ticks));
            }
            Event::Retrying { id, reason } => {
                self.bar
                    .warn(&format!("{id} failed and will be tried again: {reason}"));
                self.ended(id, 0);
            }
            Event::Failed { id, reason } => {
                self.bar.warn(&format!("{id} is set aside: {reason}"));
                let planned = self.current.get(id).map_or(0, |current| current.planned);
                self.scenarios.failed += 1;
                self.finished_without_us(id, planned);
            }
            Event::Said(line) => self.bar.say(line),
            Event::Warned(line) => self.bar.warn(line),
        }
    }
}
