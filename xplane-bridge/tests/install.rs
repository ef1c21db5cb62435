//! The plugin is installed into X-Planes in which it can work, and into no other.

use std::fs;
use std::path::Path;

use xplane_bridge::install::{FileChange, install_plugin};

const X_PLANE_12: &str =
    "Log.txt for X-Plane 12.4.0-r2-9b69b91a (build 124210 Linux 64-bit, Vulkan)\n";
const X_PLANE_11: &str = "Log.txt for X-Plane 11.55r2 (build 115502 Linux 64-bit)\n";

/// A folder as X-Plane leaves it: its log, its plugins, and XPPython3 with its log if it has one.
fn x_plane_folder(log: &str, xppython3_log: Option<&str>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir_all(path("Resources/plugins/PythonPlugins")).unwrap();
    fs::create_dir_all(path("Resources/default scenery")).unwrap();
    fs::write(path("Log.txt"), log).unwrap();
    if let Some(text) = xppython3_log {
        let xppython3 = path("Resources/plugins/XPPython3/lin_x64");
        fs::create_dir_all(&xppython3).unwrap();
        fs::write(xppython3.join("XPPython3.xpl"), "").unwrap();
        fs::write(path("XPPython3Log.txt"), text).unwrap();
    }
    folder
}

/// Files that a run changes, and the steps that it names.
fn changes(folder: &Path) -> (Vec<(FileChange, String)>, String) {
    let report = install_plugin(folder).unwrap();
    let files = report.files.into_iter();
    let changed = files.filter(|file| file.change != FileChange::Unchanged);
    let changed = changed.map(|file| (file.change, file.path)).collect();
    (changed, report.next_steps.join("\n"))
}

#[test]
fn the_plugin_is_written_once_and_what_differs_is_renewed() {
    for (log, xppython3, step) in [
        (
            X_PLANE_12,
            "[XPPython3] Version 4.7.0 Started -- Sat\n",
            "Accept incoming connections",
        ),
        (
            X_PLANE_11,
            "[XPPython3] Version 3.1.5 - for Python 3.10 Started\n",
            "Vulkan/Metal driver off",
        ),
    ] {
        let folder = x_plane_folder(log, Some(xppython3));
        let python_plugins = folder.path().join("Resources/plugins/PythonPlugins");
        let (first, steps) = changes(folder.path());
        assert!(first.len() > 15, "{first:?}");
        assert!(
            first
                .iter()
                .all(|(change, _)| *change == FileChange::Written)
        );
        assert!(
            steps.contains(step) && steps.contains("Restart X-Plane"),
            "{steps}"
        );
        let (second, steps) = changes(folder.path());
        assert_eq!(second, []);
        assert!(
            steps.contains(step) && !steps.contains("Restart X-Plane"),
            "{steps}"
        );

        fs::write(python_plugins.join("dtd_bridge/wire.py"), "old").unwrap();
        fs::write(python_plugins.join("dtd_bridge/gone.py"), "older").unwrap();
        fs::write(python_plugins.join("dtd_bridge.ini"), "[link]").unwrap();
        let name = |file: &str| format!("Resources/plugins/PythonPlugins/dtd_bridge/{file}");
        let expected = [
            (FileChange::Written, name("wire.py")),
            (FileChange::Removed, name("gone.py")),
        ];
        assert_eq!(changes(folder.path()).0, expected);
        assert_eq!(
            fs::read(python_plugins.join("dtd_bridge.ini")).unwrap(),
            b"[link]"
        );
    }
}

#[test]
fn an_x_plane_in_which_it_cannot_work_is_refused_with_the_reason_and_left_alone() {
    let old = "[XPPython3] Version 3.0.9 Started\n";
    let new = "[XPPython3] Version 4.7.0 Started\n";
    for (log, xppython3, words) in [
        ("nothing", Some(new), "Start X-Plane once"),
        (
            "Log.txt for X-Plane 11.41r1\n",
            Some(new),
            "11.41 is too old",
        ),
        (X_PLANE_12, None, "Install XPPython3 4.7 or newer"),
        (X_PLANE_11, None, "Install XPPython3 3.1.5"),
        (
            X_PLANE_11,
            Some(new),
            "XPPython3 4.7.0 is not compatible with X-Plane 11.55",
        ),
        (
            X_PLANE_12,
            Some(old),
            "XPPython3 3.0.9 is not compatible with X-Plane 12.4.0",
        ),
    ] {
        let folder = x_plane_folder(log, xppython3);
        let said = install_plugin(folder.path()).unwrap_err().to_string();
        assert!(said.contains(words), "{words}: {said}");
        let plugins = folder.path().join("Resources/plugins/PythonPlugins");
        assert_eq!(fs::read_dir(plugins).unwrap().count(), 0);
    }
    let elsewhere = tempfile::tempdir().unwrap();
    let said = install_plugin(elsewhere.path()).unwrap_err().to_string();
    assert!(said.contains("is not X-Plane's folder"), "{said}");
}

#[test]
fn an_xppython3_that_has_never_run_is_believed_and_mentioned() {
    let folder = x_plane_folder(X_PLANE_12, Some("nothing yet"));
    fs::remove_file(folder.path().join("XPPython3Log.txt")).unwrap();
    let report = install_plugin(folder.path()).unwrap();
    assert_eq!((report.xppython3, report.warnings), (None, vec![]));
    assert!(report.next_steps.join("\n").contains("has never run here"));
}

#[test]
fn a_log_without_a_version_is_not_taken_for_a_missing_one() {
    let folder = x_plane_folder(X_PLANE_12, Some("something else\n"));
    let report = install_plugin(folder.path()).unwrap();
    let [warning] = &report.warnings[..] else {
        panic!("{:?}", report.warnings)
    };
    assert!(
        warning.contains("XPPython3Log.txt does not say which XPPython3")
            && warning.contains("4.7 or newer"),
        "{warning}"
    );
    let steps = report.next_steps.join("\n");
    assert!(
        !steps.contains("has never run") && !steps.contains("is missing"),
        "{steps}"
    );
}

#[test]
fn a_pair_that_nobody_has_seen_work_is_installed_with_a_warning_and_a_known_one_without() {
    for (log, version, words) in [
        (X_PLANE_12, "3.1.5", Some("3.1.5 is older than what")),
        (X_PLANE_12, "4.6.0", Some("4.6.0 is older than what")),
        (X_PLANE_12, "4.7.0", None),
        (X_PLANE_12, "5.0.1", None),
        (X_PLANE_11, "4.6.0", Some("4.6.0 is not known to work")),
        (X_PLANE_11, "4.0.0", Some("install XPPython3 3.1.5")),
        (X_PLANE_11, "3.1.5", None),
        (X_PLANE_11, "3.1", None),
    ] {
        let said = format!("[XPPython3] Version {version} Started\n");
        let folder = x_plane_folder(log, Some(&said));
        let report = install_plugin(folder.path()).unwrap();
        assert_eq!(report.xppython3.as_deref(), Some(version));
        match words {
            None => assert_eq!(report.warnings, Vec::<String>::new(), "{log}{version}"),
            Some(words) => assert!(
                report.warnings.len() == 1 && report.warnings[0].contains(words),
                "{log}{version}: {:?}",
                report.warnings
            ),
        }
    }
}

#[test]
fn the_last_steps_are_the_doctor_and_then_the_recording() {
    for log in [X_PLANE_11, X_PLANE_12] {
        let version = if log == X_PLANE_11 { "3.1.5" } else { "4.7.0" };
        let said = format!("[XPPython3] Version {version} Started\n");
        let folder = x_plane_folder(log, Some(&said));
        let steps = install_plugin(folder.path()).unwrap().next_steps;
        let [.., doctor, generate] = &steps[..] else {
            panic!("{steps:?}")
        };
        assert!(
            doctor.contains("dtd doctor") && generate.contains("dtd generate"),
            "{steps:?}"
        );
    }
}
