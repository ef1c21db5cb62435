//! `dtd doctor`: examines a live connection point by point.

use std::fs::{self, File};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use dataset::Error;
use dataset::files::json_file::write_json;
use dataset::geometry::runway::Runway;
use generator::sweep::Sweep;
use tokio::process::Command;
use tokio::sync::oneshot;
use tokio::time::timeout;
use xplane_bridge::doctor::{Check, DoctorOptions, Intent, Measuring, Verdict, examine};
use xplane_bridge::link::{LinkToken, PictureSize};
use xplane_bridge::udp::discovery::{DISCOVERY_TIMEOUT, the_announced};
use xplane_bridge::{LocalUdp, WebApiPlace, announced_link_port, somebody_answers};
use xplane_tape::{RecordOptions, record};

use super::Outcome;
use super::address::simulator;
use super::async_runtime::async_runtime;
use super::output::print_json;
use crate::args::simulator::DoctorArgs;
use crate::failure::{Ending, Failure};

/// The sweep that most people record first.
const USUAL_SWEEP: &str = "demo.toml";
/// X-Plane's default address.
const USUAL_ADDRESS: (Ipv4Addr, u16) = (Ipv4Addr::LOCALHOST, 49_000);
/// Files of a first hour.
const TAPE: &str = "session.mcap";
const REPORT: &str = "report.json";
/// Output of the restart command.
const RESTART_LOG: &str = "restart.log";
/// Longest silence of a restarted X-Plane, twice a cold start, and longest time that the command for it may take.
const BACK_WITHIN: Duration = Duration::from_secs(600);
const ANSWER_WITHIN: Duration = Duration::from_secs(2);

/// Runs the verb. Fails if a check does.
pub(crate) fn run(args: &DoctorArgs) -> Outcome {
    // Without an address, the X-Plane that announces itself is examined.
    let address = match &args.sim {
        Some(text) => simulator(text)?,
        None => None,
    };
    let web_api = match args.web_api {
        Some(place) => place,
        None => WebApiPlace::from_environment().map_err(Failure::bad_input)?,
    };
    let (intent, runway) = intent(args.sweep.as_deref())?.unzip();
    if args.first_hour.is_some() && runway.is_none() {
        return Err(Failure::bad_input_message(
            "--first-hour lands on the runway of a sweep: name it with --sweep SWEEP.toml",
        ));
    }
    let options = DoctorOptions {
        web_api,
        local_udp: args.local_udp.options(),
        measuring: match (args.measure || args.first_hour.is_some(), args.no_measure) {
            (true, _) => Measuring::Again,
            (_, true) => Measuring::Never,
            _ => Measuring::Once,
        },
        intent,
        first_hour: runway.filter(|_| args.first_hour.is_some()),
        ..DoctorOptions::at(address)
    };
    if options.measuring != Measuring::Never && !args.json {
        eprintln!(
            "doctor: an X-Plane 12 with our plugin is measured once per installation, which takes up to eight minutes if clouds are slow \
             (--no-measure leaves it out)"
        );
    }
    let mut show = |check: &Check| {
        if !args.json {
            print(check);
        }
    };
    let restart = args.restart_simulator.as_deref();
    let checks = async_runtime()?.block_on(async {
        match &args.first_hour {
            Some(out) => recorded(out, options, restart, &mut show).await,
            None => Ok(examine(&options, &mut show).await),
        }
    })?;
    if args.json {
        print_json(&checks)?;
    }
    match checks
        .iter()
        .filter(|check| check.verdict == Verdict::Failed)
        .count()
    {
        0 => Ok(Ending::Done),
        failed => Err(Failure::Failed(anyhow::anyhow!(
            "{failed} of {} checks failed",
            checks.len()
        ))),
    }
}

/// Examines through a recorder, and leaves its tape and the checks in a folder.
async fn recorded(
    out: &Path,
    mut options: DoctorOptions,
    restart: Option<&str>,
    show: &mut (dyn FnMut(&Check) + Send),
) -> Result<Vec<Check>, Failure> {
    fs::create_dir_all(out).map_err(Error::io("create", out))?;
    let noting = options.local_udp.clone();
    let local_udp = LocalUdp {
        notes: None,
        ..noting.clone()
    };
    let simulator = match options.address {
        Some(address) => address,
        None => (the_announced(DISCOVERY_TIMEOUT, &local_udp).await)
            .map_or(USUAL_ADDRESS.into(), |one| one.address),
    };
    options.own_link_port = announced_link_port(simulator, ANSWER_WITHIN, &local_udp).await;
    let to_record = RecordOptions {
        token: LinkToken::from_environment(),
        local_udp: noting,
        ..RecordOptions::new(simulator, out.join(TAPE))
    };
    let (say_ready, ready) = oneshot::channel();
    let (stop, stopped) = oneshot::channel::<()>();
    let is_ready = |addresses| {
        let _examination_ended = say_ready.send(addresses);
    };
    let recording = record(to_record, is_ready, async {
        let _either_way = stopped.await;
    });
    let examining = async {
        let mut checks = Vec::new();
        if let Ok(addresses) = ready.await {
            options.address = Some(addresses.udp);
            options.local_udp = LocalUdp::default();
            checks = examine(&options, show).await;
        }
        drop(stop);
        checks
    };
    let (recorded, mut checks) = tokio::join!(recording, examining);
    // Before anything that may not end: half an hour would be lost. A recorder that did not begin leaves an earlier report as it is.
    if !checks.is_empty() {
        write_json(&out.join(REPORT), &checks)?;
    }
    recorded.map_err(|error| Failure::bad_input_if(error.is_bad_input(), error))?;
    if let Some(command) = restart {
        checks.push(restarted(command, out, simulator, &local_udp).await?);
        checks.last().into_iter().for_each(show);
        write_json(&out.join(REPORT), &checks)?;
    }
    eprintln!(
        "doctor: {} has a report and a tape: please send it",
        out.display()
    );
    Ok(checks)
}

/// Restarts the simulator by a command, and waits until it answers: it does not while it asks a question. The command's output is kept in
/// the folder.
async fn restarted(
    command: &str,
    out: &Path,
    simulator: SocketAddr,
    local_udp: &LocalUdp,
) -> Result<Check, Failure> {
    let log = out.join(RESTART_LOG);
    // A file, since a simulator that the command leaves behind holds its output open.
    let said = File::create(&log).map_err(Error::io("create", &log))?;
    let said_too = said.try_clone().map_err(Error::io("open", &log))?;
    let mut shell = Command::new("sh");
    shell
        .args(["-c", command])
        .env("DTD_SIMULATOR", simulator.to_string())
        .stdin(Stdio::null())
        .stdout(said)
        .stderr(said_too)
        // Ctrl-C is not meant for the simulator that it starts.
        .process_group(0);
    let began = Instant::now();
    let ended = timeout(BACK_WITHIN, shell.status()).await;
    let ended_s = began.elapsed().as_secs_f64();
    let warning = |found: String, hint: &str| {
        let hint = format!("{hint}; its output is in {}", log.display());
        Check::warning("restart", found, hint)
    };
    let in_shell = "Run it in a shell, in the background if it stays with the simulator";
    Ok(match ended {
        Ok(Ok(status)) if status.success() => {
            let began = Instant::now();
            let mut answers = false;
            while !answers && began.elapsed() < BACK_WITHIN {
                answers = somebody_answers(simulator, ANSWER_WITHIN, local_udp).await;
            }
            let back_s = began.elapsed().as_secs_f64();
            let ended = format!("the command ended after {ended_s:.0} s");
            if answers {
                Check::ok(
                    "restart",
                    format!("{ended}, the simulator answers {back_s:.0} s later"),
                )
            } else {
                warning(
                    format!("{ended}, no answer within {back_s:.0} s"),
                    "Look at its screen, and write down what you see: does it ask whether to start in safe mode, or show its menu?",
                )
            }
        }
        Ok(Ok(status)) => warning(format!("the command ended with {status}"), in_shell),
        Ok(Err(error)) => warning(format!("cannot run sh: {error}"), in_shell),
        Err(_) => warning(
            format!("the command did not end within {ended_s:.0} s"),
            in_shell,
        ),
    })
}

/// The sweep to record, with its image size and its runway.
fn intent(sweep: Option<&Path>) -> Result<Option<(Intent, Runway)>, Failure> {
    let file = match sweep {
        Some(file) => file.to_owned(),
        None => PathBuf::from(USUAL_SWEEP),
    };
    if sweep.is_none() && !file.is_file() {
        return Ok(None);
    }
    let Sweep {
        picture, runway, ..
    } = Sweep::read(&file).map_err(Failure::bad_input)?;
    let intent = Intent {
        sweep: file.display().to_string(),
        pictures: PictureSize {
            width_px: picture.width_px,
            height_px: picture.height_px,
        },
    };
    Ok(Some((intent, runway)))
}

fn print(check: &Check) {
    println!("{:<8} {:<18} {}", check.verdict, check.name, check.found);
    if let Some(hint) = &check.hint {
        println!("{:<8} {:<18} -> {hint}", "", "");
    }
}
