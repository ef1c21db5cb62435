//! Assignment of scenarios to training, validation and test.

pub(crate) mod flight_parts;
pub(crate) mod leave_out;
pub(crate) mod marked_scenarios;
pub(crate) mod scenario_split;
