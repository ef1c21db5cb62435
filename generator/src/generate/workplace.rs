//! The folder in which one scenario is being made, held by one process at a time.

use std::fs::{self, File, TryLockError};

use dataset::Error;
use dataset::corpus::{Corpus, ScenarioFolder};

use super::error::ScenarioError;

/// An empty `<id>.partial/`, locked until this value is dropped. The lock is the system's own and ends with the process, however it
/// ends.
pub(super) struct Workplace {
    folder: ScenarioFolder,
    _lock: File,
}

impl Workplace {
    /// Takes the folder of a scenario and clears what an earlier, unfinished attempt left.
    pub(super) fn take(corpus: &Corpus, id: &str) -> Result<Self, ScenarioError> {
        let folder = corpus.partial_scenario(id);
        let root = folder.root();
        fs::create_dir_all(root).map_err(Error::io("create", root))?;
        let lock = File::open(root).map_err(Error::io("open", root))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(ScenarioError::Busy {
                    folder: root.to_owned(),
                });
            }
            Err(TryLockError::Error(source)) => return Err(Error::io("lock", root)(source).into()),
        }
        for entry in fs::read_dir(root).map_err(Error::io("list", root))? {
            let path = entry.map_err(Error::io("list", root))?.path();
            let removed = if path.is_dir() {
                fs::remove_dir_all(&path)
            } else {
                fs::remove_file(&path)
            };
            removed.map_err(Error::io("remove", &path))?;
        }
        let views = root.join("views");
        fs::create_dir(&views).map_err(Error::io("create", &views))?;
        Ok(Self {
            folder,
            _lock: lock,
        })
    }

    pub(super) fn folder(&self) -> &ScenarioFolder {
        &self.folder
    }

    /// Takes the folder away. Failing to do so does no harm: the next attempt clears it.
    pub(super) fn abandon(self) {
        if let Err(error) = fs::remove_dir_all(self.folder.root()) {
            tracing::debug!(%error, folder = %self.folder.root().display(), "left behind");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_workplace_is_clean_and_has_one_owner() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let left = corpus.partial_scenario("0001").root().join("views");
        fs::create_dir_all(&left).unwrap();
        fs::write(left.join("left.mp4"), "half").unwrap();

        let mine = Workplace::take(&corpus, "0001").unwrap();
        assert_eq!(
            fs::read_dir(mine.folder().root().join("views"))
                .unwrap()
                .count(),
            0
        );
        assert!(matches!(
            Workplace::take(&corpus, "0001"),
            Err(ScenarioError::Busy { .. })
        ));
        drop(mine);
        Workplace::take(&corpus, "0001").unwrap().abandon();
        assert!(!corpus.partial_scenario("0001").root().exists());
    }
}
