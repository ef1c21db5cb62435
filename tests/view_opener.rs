//! `dtd view` says that a page was opened only if the program that opens it said so.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::process::Stdio;

use testkit::command::{Dtd, Server, text};
use testkit::short_corpus;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

#[test]
fn an_opener_that_fails_is_not_called_a_success() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    short_corpus::write(&corpus, &["0001-a"]);
    for (script, words) in [
        (
            "#!/bin/sh\nexit 3\n",
            "no browser could be started; open http://",
        ),
        ("#!/bin/sh\nexit 0\n", "opened http://"),
    ] {
        for name in ["xdg-open", "open"] {
            let opener = folder.path().join(name);
            fs::write(&opener, script).unwrap();
            fs::set_permissions(&opener, fs::Permissions::from_mode(0o755)).unwrap();
        }
        let mut command =
            DTD.command(&["view", text(&corpus), "--port", "0", "--until-stdin-ends"]);
        command.env("PATH", folder.path()).stderr(Stdio::piped());
        let mut server = Server::start(&mut command);
        let stderr = server.process().stderr.take().unwrap();
        let mut lines = BufReader::new(stderr).lines().map(Result::unwrap);
        let line = lines.find(|line| line.contains(" view: ")).unwrap();
        assert!(line.contains(words), "{line}");
        server.end();
    }
}
