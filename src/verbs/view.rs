//! `dtd view`: a page that shows a corpus.

use std::env;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;

use dataset::corpus::Corpus;
use serde_json::json;
use viewer::{ViewOptions, serve};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::stdin_ended::stdin_ended;
use crate::args::view::ViewArgs;
use crate::failure::{Ending, Failure};
use crate::signals::CleanStop;

/// Opens an address with the program that the user chose for it.
const OPENER: &str = if cfg!(target_os = "macos") {
    "open"
} else {
    "xdg-open"
};

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &ViewArgs) -> Outcome {
    let corpus = Corpus::open(&args.corpus).map_err(Failure::of_corpus)?;
    let is_none = |run: &&PathBuf| !run.exists() || Corpus::is_at(run);
    if let Some(missing) = args.runs.iter().find(is_none) {
        return Err(Failure::bad_input_message(format!(
            "there is no run {}; expected the folder of `dtd train` and `dtd evaluate`, or a table of `dtd predict`",
            missing.display()
        )));
    }
    let options = ViewOptions {
        corpus,
        runs: args.runs.clone(),
        port: args.port,
    };
    let stop = CleanStop::begin();
    let runtime = async_runtime()?;
    let ending = runtime.block_on(async {
        tokio::select! {
            result = serve(options, |address| announce(address, args.no_open)) => result.map_err(Failure::bad_input)?,
            () = stop.switch().cancelled() => {}
            () = stdin_ended(), if args.until_stdin_ends => {}
        }
        Ok(Ending::Done)
    });
    // An image without a waiting client need not be finished.
    runtime.shutdown_background();
    ending
}

fn announce(address: SocketAddr, no_open: bool) {
    let url = format!("http://{address}/");
    println!("{}", json!({ "address": address, "url": url }));
    if no_open {
        return;
    }
    let opener = Command::new(OPENER)
        .arg(&url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    // It may wait for the browser, and the page is served meanwhile.
    thread::spawn(move || match opener.and_then(|mut opener| opener.wait()) {
        Ok(status) if status.success() => {
            eprintln!("view: opened {url} in the browser; Ctrl-C ends it");
        }
        _ => {
            eprintln!("view: no browser could be started; open {url} in one. Ctrl-C ends it");
            if env::var_os("SSH_CONNECTION").is_some() {
                let port = address.port();
                eprintln!(
                    "view: through ssh, forward the port on your own computer: ssh -L {port}:{address} HOST"
                );
            }
        }
    });
}
