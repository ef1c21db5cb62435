//! The levers of the engines: one by one, all at once, and all at once with reverse thrust.
//!
//! Clients such as XPlaneConnectX write the last one. That writing one name moves the others is X-Plane's; that the name for all reads
//! the mean of levers that differ is our choice.

use crate::datarefs::Datarefs;

/// The lever of each engine, 0 to 1.
const EACH: &str = "sim/cockpit2/engine/actuators/throttle_ratio";
/// All levers at once, 0 to 1.
const ALL: &str = "sim/cockpit2/engine/actuators/throttle_ratio_all";
/// All throttles, down to -1 with full reverse thrust.
const ALL_WITH_REVERSE: &str = "sim/cockpit2/engine/actuators/throttle_jet_rev_ratio_all";

/// Lets the other names follow one that was written.
pub(super) fn written(path: &str, datarefs: &mut Datarefs) {
    let name = path.split('[').next().unwrap_or(path);
    let engines = datarefs.find(EACH).map_or(0, |(_, levers)| levers.len());
    let ratio = match name {
        ALL | ALL_WITH_REVERSE => datarefs.get(name).clamp(-1.0, 1.0),
        EACH => {
            let sum: f64 = (0..engines).map(|at| datarefs.get(&lever(at))).sum();
            sum / engines as f64
        }
        _ => return,
    };
    if name != EACH {
        for at in 0..engines {
            datarefs.set(&lever(at), ratio.max(0.0));
        }
    }
    datarefs.set(ALL, ratio.max(0.0));
    datarefs.set(ALL_WITH_REVERSE, ratio);
}

fn lever(at: usize) -> String {
    format!("{EACH}[{at}]")
}

#[cfg(test)]
mod tests {
    use super::*;
    use xplane_bridge::datarefs::Generation;

    fn after(path: &str, value: f64) -> [f64; 3] {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        datarefs.write_exact(path, value).unwrap();
        written(path, &mut datarefs);
        [&lever(1), ALL, ALL_WITH_REVERSE].map(|path| datarefs.get(path))
    }

    #[test]
    fn all_names_of_the_levers_follow_the_one_that_is_written() {
        assert_eq!(after(ALL, 0.5), [0.5, 0.5, 0.5]);
        assert_eq!(after(ALL_WITH_REVERSE, 0.75), [0.75, 0.75, 0.75]);
        assert_eq!(after(ALL_WITH_REVERSE, -1.0), [0.0, 0.0, -1.0]);
        let [lever, all, _] = after(&lever(1), 1.0);
        assert!(lever == 1.0 && all > 0.0 && all < 1.0, "{lever} {all}");
    }
}
