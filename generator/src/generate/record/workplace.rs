//! Recording folder, owned by the holder of the scenario's claim.

use std::fs;

use dataset::Error;
use dataset::corpus::claim::Claim;
use dataset::corpus::seal;
use dataset::corpus::{Corpus, ScenarioFolder};

/// A `<id>.partial/`, ours because we hold the claim.
pub(crate) struct Workplace {
    folder: ScenarioFolder,
}

impl Workplace {
    /// Empty scenario folder: leftovers from unfinished attempts are cleared.
    pub(crate) fn clear(corpus: &Corpus, id: &str, _claim: &Claim) -> dataset::Result<Self> {
        let folder = corpus.partial_scenario(id);
        let root = folder.root();
        // If a link was planted there, only the link is removed.
        if let Ok(found) = root.symlink_metadata() {
            if !found.is_dir() && !found.is_symlink() {
                return Err(Error::corpus(
                    root,
                    "is not a folder, expected the one where the scenario is made; move it away and run the same command again",
                ));
            }
            fs::remove_dir_all(root).map_err(Error::io("remove", root))?;
        }
        let views = root.join("views");
        fs::create_dir_all(&views).map_err(Error::io("create", &views))?;
        Ok(Self { folder })
    }

    /// The folder as an earlier run left it, if that run was killed between sealing and renaming: all its files exist and match the
    /// sealed hashes.
    pub(crate) fn finished(
        corpus: &Corpus,
        id: &str,
        config_hash: &str,
        _claim: &Claim,
    ) -> Option<Self> {
        let folder = corpus.partial_scenario(id);
        let seal = folder.seal().ok()??;
        (seal.config_hash == config_hash && seal::faults(folder.root()).ok()?.is_empty())
            .then_some(Self { folder })
    }

    pub(crate) fn folder(&self) -> &ScenarioFolder {
        &self.folder
    }

    /// Removes the folder. A failure does no harm: the next attempt clears it.
    pub(crate) fn abandon(self) {
        if let Err(error) = fs::remove_dir_all(self.folder.root()) {
            tracing::debug!(%error, folder = %self.folder.root().display(), "left behind");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::corpus::claim::Claimed;

    #[test]
    fn what_is_no_folder_is_named_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let Claimed::Mine(claim) = Claim::take(&corpus, "0001").unwrap() else {
            panic!("nobody else is there");
        };
        let partial = corpus.partial_scenario("0001").root().to_owned();
        fs::write(&partial, "notes").unwrap();
        let error = Workplace::clear(&corpus, "0001", &claim).err().unwrap();
        assert!(error.to_string().contains("is not a folder"), "{error}");
        assert_eq!(fs::read(&partial).unwrap(), b"notes");
    }

    #[test]
    fn what_a_killed_run_left_is_cleared_unless_it_was_finished() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let Claimed::Mine(claim) = Claim::take(&corpus, "0001").unwrap() else {
            panic!("nobody else is there");
        };
        let finished = |hash| Workplace::finished(&corpus, "0001", hash, &claim).is_some();
        assert!(!finished("config"));

        let place = Workplace::clear(&corpus, "0001", &claim).unwrap();
        let video = place.folder().root().join("views/left.mp4");
        fs::write(&video, "video").unwrap();
        assert!(!finished("config"), "it is not sealed");
        seal::seal_folder(place.folder().root(), "config").unwrap();
        assert!(finished("config"));
        assert!(!finished("other"), "it was made from other parameters");
        fs::write(&video, "vide").unwrap();
        assert!(!finished("config"), "a file does not match its seal");

        let place = Workplace::clear(&corpus, "0001", &claim).unwrap();
        assert!(!video.exists());
        place.abandon();
        assert!(!corpus.partial_scenario("0001").root().exists());
    }
}
