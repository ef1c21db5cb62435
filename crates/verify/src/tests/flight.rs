use super::*;

#[test]
fn changes_of_the_frames_are_found_in_their_rows() {
    type Change = fn(&mut Vec<TickRow>);
    let changes: [(Change, &[&str]); 12] = [
        (
            |rows| rows[2].pose = rows[3].pose,
            &[
                "frames.parquet row 2 view left: pose drawn is not the tick's",
                "row 2: label: dtd_m",
                "flight is not continuous",
            ],
        ),
        (
            |rows| {
                let pose = rows[3].pose;
                (rows[2].pose, rows[2].labels) = (pose, rows[3].labels);
                let stamps = rows[2].views.iter_mut();
                stamps.for_each(|stamp| stamp.echoed_pose = pose);
            },
            &["row 2: flight is not continuous"],
        ),
        (
            |rows| rows[4].views[1].echoed_pose.altitude_msl_m += 0.011,
            &["frames.parquet row 4 view right: pose drawn is not the tick's: position"],
        ),
        (
            |rows| rows[1].labels.as_mut().unwrap().dtd_m += 0.001,
            &["frames.parquet row 1: label: dtd_m"],
        ),
        (
            |rows| {
                for row in rows {
                    let labels = row.labels.as_mut().unwrap();
                    *labels.time_to_touchdown_s.as_mut().unwrap() += 2.5;
                }
            },
            &["row 4: time_to_touchdown_s: goes from 3.5 to 1.5"],
        ),
        (
            |rows| {
                let [first, second, ..] = &mut rows[..] else {
                    unreachable!("there are five");
                };
                std::mem::swap(&mut first.pose, &mut second.pose);
                std::mem::swap(&mut first.labels, &mut second.labels);
            },
            &["row 1: dtd_m: grows"],
        ),
        (
            |rows| drop(rows.remove(2)),
            &["has 4 rows, but scenario.json says 5 ticks"],
        ),
        (
            |rows| rows[3] = rows[2].clone(),
            &[
                "row 3: tick: is 2, expected 3",
                "row 3 view left: simulator frames out of order",
            ],
        ),
        (
            |rows| rows[0].views.swap(0, 1),
            &[
                "row 0 view left: camera drawn is not the calibrated one",
                "row 0 view right: simulator frames out of order",
            ],
        ),
        (
            |rows| rows[1].time_ns += 1,
            &["row 1: time: time_ns is 2000000001"],
        ),
        (
            |rows| rows[1].views[0].pts = 1,
            &["row 1 view left: timestamp: pts_left is 1, expected 2"],
        ),
        (
            |rows| rows.iter_mut().for_each(|row| row.time_ns += 5),
            &["time: 2 more rows"],
        ),
    ];
    for (change, words) in changes {
        let findings = Example::with_table(change);
        words
            .iter()
            .for_each(|words| assert_found(&findings, words));
    }
    let within = |rows: &mut Vec<TickRow>| rows[4].views[1].echoed_pose.altitude_msl_m += 0.009;
    assert_eq!(Example::with_table(within), "");
    let findings = Example::with(|example| {
        let path = example.scenario().frames_path();
        overwrite(&path, "true_airspeed_mps", 3, f64::NAN);
    });
    assert_found(&findings, "row 3: true_airspeed_mps NaN is out of range");
}

/// Changes a recording's frames in a block of five ticks, some of them shown again, and returns the findings.
fn with_block(repeated_ticks: u32, change: impl FnOnce(&mut Vec<TickRow>)) -> String {
    Example::with(|example| {
        let mut record = record(IDS[0]);
        record.blocks = Some(Blocks {
            ticks: TICKS,
            frames_behind: vec![0],
            count: 2,
            measured: 2,
            held_ticks: 0,
            repeated_ticks,
        });
        write_json(&example.scenario().record_path(), &record).unwrap();
        let mut table = frames();
        for (tick, row) in table.rows.iter_mut().enumerate() {
            for (view, stamp) in row.views.iter_mut().enumerate() {
                stamp.sim_frame = (100 * view + tick) as u64;
            }
        }
        change(&mut table.rows);
        table.write(&example.scenario().frames_path()).unwrap();
    })
}

#[test]
fn ticks_that_were_exchanged_in_a_block_are_found_unless_so_many_were_shown_again() {
    let exchange = |rows: &mut Vec<TickRow>| {
        let [first, second] = [1, 3].map(|row: usize| rows[row].views[1].sim_frame);
        rows[1].views[1].sim_frame = second;
        rows[3].views[1].sim_frame = first;
    };
    assert_eq!(with_block(0, |_| {}), "");
    assert_found(
        &with_block(0, exchange),
        "row 2 view right: simulator frames out of order: by sim_frame, 2 ticks were drawn after later ones",
    );
    // Lost, and shown again after all others.
    let lost = |rows: &mut Vec<TickRow>| rows[1].views[0].sim_frame = 50;
    assert_eq!(with_block(1, lost), "");
    assert_found(&with_block(0, lost), "1 ticks were drawn after later ones");
    assert_found(
        &with_block(1, exchange),
        "2 ticks were drawn after later ones",
    );
}
