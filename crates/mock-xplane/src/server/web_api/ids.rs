//! Ids of datarefs and commands during one session of the simulator.
//!
//! A client that keeps an id over a restart must fail, as it would with X-Plane: no two sessions share an id.

use std::collections::BTreeMap;

use crate::datarefs::Datarefs;

use super::super::world::World;

/// Ids available to a session.
const NUMBERS_PER_SESSION: u64 = 100_000;
/// Commands are numbered from here on.
const FIRST_COMMAND: u64 = 50_000;

#[derive(Debug)]
pub(super) struct Ids {
    names: BTreeMap<u64, &'static str>,
    first_command: u64,
}

impl Ids {
    pub(super) fn new(session: u64, datarefs: &Datarefs) -> Self {
        let first = session * NUMBERS_PER_SESSION;
        let first_command = first + FIRST_COMMAND;
        let datarefs = (first..).zip(datarefs.iter().map(|(dataref, _)| dataref.name));
        let commands = (first_command..).zip(World::commands());
        Self {
            names: datarefs.chain(commands).collect(),
            first_command,
        }
    }

    pub(super) fn datarefs(&self) -> impl Iterator<Item = (u64, &'static str)> {
        self.names
            .range(..self.first_command)
            .map(|(&id, &name)| (id, name))
    }

    pub(super) fn commands(&self) -> impl Iterator<Item = (u64, &'static str)> {
        self.names
            .range(self.first_command..)
            .map(|(&id, &name)| (id, name))
    }

    pub(super) fn dataref(&self, id: u64) -> Option<&'static str> {
        self.names
            .get(&id)
            .copied()
            .filter(|_| id < self.first_command)
    }

    pub(super) fn command(&self, id: u64) -> Option<&'static str> {
        self.names
            .get(&id)
            .copied()
            .filter(|_| id >= self.first_command)
    }
}
