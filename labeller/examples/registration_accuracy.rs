//! How far the disparity between two views is off, from boxes and from registration, by distance.
//!
//! `cargo run --release -p labeller --example registration_accuracy -- CORPUS [MODEL_HASH]` prints, for each mile to touchdown of a
//! labelled corpus that `dtd detect` was run on: the pairs of boxes, how many were registered, and the robust standard deviation
//! (1.4826 times the median of the absolute deviations from the bin's median) of the errors of both, pixels. The truth is a point of
//! the aircraft, projected into both views from trajectory and cameras: 3.3 m ahead of the centre of gravity, where what is visible
//! of it is on average. `error/sd` is the same for the error over its stated standard deviation: 1 if the latter is honest.

use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::detections::{Detection, models_of};
use dataset::units::METERS_PER_NAUTICAL_MILE;
use glam::{DVec2, DVec3};

/// From the centre of gravity to what is visible: a constant that takes most of the bias out of the demo's corpus, for all distances.
const VISIBLE_AHEAD_M: f64 = 3.3;
/// Bins of a mile; the overall figures are those from 1 to 10.
const BINS: usize = 10;

/// A pair of boxes of one tick.
struct Pair {
    dtd_nm: f64,
    boxes: DVec2,
    /// Error and stated standard deviation.
    registered: Option<(DVec2, DVec2)>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(root) = arguments.first() else {
        return Err("expected CORPUS [MODEL_HASH]".into());
    };
    let corpus = Corpus::open(Path::new(root))?;
    let (mut pairs, mut seconds, mut rows) = (Vec::new(), 0.0, 0.0);
    let mut unanswered: BTreeMap<&str, usize> = BTreeMap::new();
    for folder in corpus.scenarios()? {
        let models = models_of(&folder)?;
        let model = match (arguments.get(1), models.as_slice()) {
            (Some(model), _) => model,
            (None, [model]) => model,
            _ => {
                return Err(
                    format!("{}: expected one model, found {models:?}", folder.id()).into(),
                );
            }
        };
        let scenario = folder.open()?;
        let calibration = scenario.calibration()?;
        let frames = scenario.frames()?;
        let best = best_of(scenario.detections(model)?.into_confirmed());
        let registrations = scenario.registrations(model)?;
        let registrations = registrations.ok_or("not registered; run `dtd detect` first")?;
        let record = std::fs::read(dataset::detections::record_path(&folder, model))?;
        let record: serde_json::Value = serde_json::from_slice(&record)?;
        seconds += record["registration"]["seconds"]
            .as_f64()
            .unwrap_or(f64::NAN);
        rows += record["registration"]["answered"]
            .as_f64()
            .unwrap_or(f64::NAN);
        for registration in registrations {
            let frame = &frames.rows[registration.tick as usize];
            let ahead_m = frame.pose.ecef_from_body() * DVec3::X * VISIBLE_AHEAD_M;
            let place_m = frame.pose.position().to_ecef() + ahead_m;
            let views = [&registration.reference, &registration.view];
            let [from, to] = views.map(|view| calibration.cameras[view].camera().project(place_m));
            let boxes = views.map(|view| best.get(&(registration.tick, view.clone())));
            let (Some(from), Some(to), [Some(a), Some(b)], Some(labels)) =
                (from, to, boxes, &frame.labels)
            else {
                continue;
            };
            let truth = to - from;
            if let Err(reason) = registration.result {
                *unanswered.entry(reason.word()).or_default() += 1;
            }
            pairs.push(Pair {
                dtd_nm: labels.dtd_m / METERS_PER_NAUTICAL_MILE,
                boxes: *b - *a - truth,
                registered: registration.result.ok().map(|shift| {
                    let sd = DVec2::new(shift.sd_x_px, shift.sd_y_px);
                    (DVec2::new(shift.dx_px, shift.dy_px) - truth, sd)
                }),
            });
        }
    }
    print(&pairs);
    println!("without an answer, though both views have a box: {unanswered:?}");
    println!("{:.2} ms a registered pair", 1e3 * seconds / rows);
    Ok(())
}

/// Centre of the best confirmed box of each picture.
fn best_of(detections: impl Iterator<Item = Detection>) -> BTreeMap<(u32, String), DVec2> {
    let mut best: BTreeMap<_, (f64, DVec2)> = BTreeMap::new();
    for Detection {
        tick,
        view,
        pixel_box,
        score,
        ..
    } in detections
    {
        let centre = DVec2::new(pixel_box.cx_px, pixel_box.cy_px);
        let there = best.entry((tick, view)).or_insert((score, centre));
        if score > there.0 {
            *there = (score, centre);
        }
    }
    best.into_iter().map(|(key, (_, at))| (key, at)).collect()
}

fn print(pairs: &[Pair]) {
    println!(
        "   NM  pairs  answered  boxes: bias    sd   registered: bias   sd x   sd y   error/sd x   y   stated sd x"
    );
    // About the bins' medians, and as they are.
    let [mut boxes, mut shifts, mut scaled] = [(); 3].map(|()| Vec::new());
    let [mut all_boxes, mut all_shifts] = [(); 2].map(|()| Vec::new());
    for nm in 0..BINS {
        let here: Vec<&Pair> = pairs.iter().filter(|p| p.dtd_nm as usize == nm).collect();
        let answered: Vec<_> = here.iter().filter_map(|p| p.registered).collect();
        if answered.is_empty() {
            continue;
        }
        let box_x: Vec<_> = here.iter().map(|p| p.boxes.x).collect();
        let [x, y] = [0, 1].map(|k| answered.iter().map(|(e, _)| e[k]).collect::<Vec<_>>());
        let [middle_x, middle_y] = [median(&x), median(&y)];
        let over = |k: usize, middle: f64| {
            let scaled = answered.iter().map(|(e, sd)| (e[k] - middle) / sd[k]);
            scaled.collect::<Vec<_>>()
        };
        let (over_x, over_y) = (over(0, middle_x), over(1, middle_y));
        let stated: Vec<_> = answered.iter().map(|(_, sd)| sd.x).collect();
        println!(
            "{nm:2}-{:<2} {:6} {:8.1} % {:11.3} {:6.3} {:16.3} {:6.3} {:6.3} {:11.2} {:5.2} {:10.3}",
            nm + 1,
            here.len(),
            100.0 * answered.len() as f64 / here.len() as f64,
            median(&box_x),
            robust_sd(&box_x),
            middle_x,
            robust_sd(&x),
            robust_sd(&y),
            robust_sd(&over_x),
            robust_sd(&over_y),
            median(&stated),
        );
        if nm > 0 {
            boxes.extend(box_x.iter().map(|e| e - median(&box_x)));
            shifts.extend(x.iter().map(|e| e - middle_x));
            scaled.extend(over_x);
            all_boxes.extend(box_x);
            all_shifts.extend(x);
        }
    }
    println!(
        "1-10: {} pairs, {:.2} % answered; robust SD about the bins' medians: boxes {:.3} px, registered {:.3} px (error/sd {:.2}); of \
         the errors as they are: boxes {:.3} px, registered {:.3} px",
        boxes.len(),
        100.0 * shifts.len() as f64 / boxes.len() as f64,
        robust_sd(&boxes),
        robust_sd(&shifts),
        robust_sd(&scaled),
        robust_sd(&all_boxes),
        robust_sd(&all_shifts),
    );
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

fn robust_sd(values: &[f64]) -> f64 {
    let middle = median(values);
    let away: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
    1.4826 * median(&away)
}
