//! Temporary.
use dataset::corpus::Corpus;
use std::path::Path;
use trainer::*;
struct P(std::time::Instant);
impl Progress for P {
    fn begin(&mut self, s: &str, t: u64) {
        eprintln!("[{:.1}] {s} {t}", self.0.elapsed().as_secs_f64());
    }
    fn advance(&mut self, d: u64, n: &str) {
        if d % 500 == 0 {
            eprintln!("[{:.1}]   {d} {n}", self.0.elapsed().as_secs_f64());
        }
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let c = Corpus::open(Path::new(&a[1])).unwrap();
    let cfg: TrainConfig = serde_json::from_str(&a[3]).unwrap();
    let mut p = P(std::time::Instant::now());
    let o = train(&c, Path::new(&a[2]), &cfg, &mut p).unwrap();
    eprintln!(
        "val {:.4} mixed {}",
        o.validation_mape_pct, o.summary.mixed_samples
    );
    let m = evaluate(&o.run, &c, &EvaluationConfig::default(), &mut p).unwrap();
    for (n, e) in &m.estimators {
        let f = |x: &metrics::ErrorFigures| {
            x.mape_pct.map_or("-".into(), |v| {
                format!("{v:.3} ({:.3}) n={}", x.sd_pct.unwrap(), x.samples)
            })
        };
        println!(
            "{n:18} all {} dual {}  bins {}",
            f(&e.overall.combination),
            f(&e.overall.dual),
            e.by_distance_nm
                .iter()
                .map(|b| format!("{:.2}", b.figures.mape_pct.unwrap_or(-1.)))
                .collect::<Vec<_>>()
                .join(" ")
        );
    }
}
