use std::fs::{self, File};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Names the folder that the test programs started by `scripts/run_tests.py` share.
const SHARED: &str = "DTD_TEST_SHARED";

/// A folder of this name that no test changes: made once for all test programs of a `scripts/run_tests.py` run, otherwise once per program.
/// Tests copy what they change.
#[derive(Debug)]
pub struct MadeOnce {
    path: PathBuf,
    /// Removes a folder that is not shared.
    _own: Option<TempDir>,
}

impl MadeOnce {
    /// Makes the folder, or waits for the program that makes it.
    ///
    /// # Panics
    ///
    /// If the folder cannot be created.
    pub fn made(name: &str, make: impl FnOnce(&Path)) -> Self {
        match std::env::var_os(SHARED) {
            Some(shared) => Self::made_in(Path::new(&shared), name, make),
            None => {
                let own = tempfile::tempdir().expect("a temporary folder");
                make(own.path());
                Self {
                    path: own.path().to_owned(),
                    _own: Some(own),
                }
            }
        }
    }

    fn made_in(shared: &Path, name: &str, make: impl FnOnce(&Path)) -> Self {
        let lock = File::create(shared.join(format!("{name}.lock"))).expect("a lock");
        lock.lock().expect("the lock");
        let (path, done) = (shared.join(name), shared.join(format!("{name}.done")));
        if !done.exists() {
            if path.exists() {
                fs::remove_dir_all(&path).expect("the folder of a program that failed is removed");
            }
            fs::create_dir(&path).expect("the folder");
            make(&path);
            File::create(done).expect("the mark");
        }
        Self { path, _own: None }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    #[test]
    fn a_shared_folder_is_made_by_the_first_that_does_not_fail() {
        let shared = tempfile::tempdir().unwrap();
        let made_with = |file: &str| {
            let made = MadeOnce::made_in(shared.path(), "corpus", |folder| {
                File::create(folder.join(file)).unwrap();
                assert_ne!(file, "half");
            });
            let entries = fs::read_dir(made.path()).unwrap();
            let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
            names.collect::<Vec<_>>()
        };
        assert!(catch_unwind(AssertUnwindSafe(|| made_with("half"))).is_err());
        assert_eq!(made_with("first"), ["first"]);
        assert_eq!(made_with("second"), ["first"]);
    }
}
