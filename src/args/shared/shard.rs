//! The option of verbs whose work on a corpus can be divided among machines.

use std::env;

use clap::Args;
use generator::plan::shard::Shard;

use crate::failure::Failure;

/// A part of the plan.
#[derive(Debug, Args)]
pub(crate) struct ShardArg {
    /// Only shard I, from 0, of N; shards may work on one corpus at the same time
    ///
    /// Each gets its share of every weather. The default is the shard of Slurm's job array (SLURM_ARRAY_TASK_ID) or of a Kubernetes Indexed
    /// Job (JOB_COMPLETION_INDEX and DTD_SHARDS), else everything.
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
}

impl ShardArg {
    /// The requested part of the plan, or the one named by the scheduler's environment.
    pub(crate) fn or_of_environment(&self, verb: &str) -> Result<Shard, Failure> {
        if let Some(shard) = self.shard {
            return Ok(shard);
        }
        let found = Shard::from_environment(|name| env::var(name).ok());
        Ok(match found.map_err(Failure::bad_input)? {
            Some((shard, variable)) => {
                eprintln!("{verb}: shard {shard}, from {variable}");
                shard
            }
            None => Shard::WHOLE,
        })
    }
}
