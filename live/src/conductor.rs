//! Joins the views, asks the estimator at each time, and writes answers and events.

mod answers;
mod overload;
mod pairing;
mod track_motion;
mod view_news;
mod withheld_news;

use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use dataset::geometry::rays::across_sd_px;
use glam::DVec2;
use labeller::{SeenBox, register_views};
use sight::background::Background;
use sight::lag::Sighting;
use trainer::live::{Candidate, Look, OnlineRun, SeenTick, SeenView, Shown};

use crate::clock::Tie;
use crate::clocks::clock_offset::Offset;
use crate::clocks::free_clocks::News;
use crate::clocks::{Clocks, ComparedClock, out_of_time, right_clock};
use crate::conductor::answers::Answers;
use crate::conductor::overload::Overload;
use crate::conductor::pairing::{Joined, Pairing};
use crate::conductor::track_motion::{TrackMotion, moved_box, moved_shift};
use crate::conductor::view_news::ViewNews;
use crate::conductor::withheld_news::{Sees, WithheldNews};
use crate::error::{Error, Result};
use crate::options::{Options, Pace};
use crate::output::lines::Lines;
use crate::output::metrics::{Fate, Metrics, Stage};
use crate::output::{Event, Line, MAX_FRESH_S, Reason, Surroundings, metrics_server};
use crate::queue::lock;
use crate::views::feed::{Message, Report};
use crate::views::search::Searched;
use crate::views::shared::{Correction, Shared};
use crate::views::{View, Views};

/// Longest wait for a message: views are judged this often without one.
const WAIT: Duration = Duration::from_millis(20);
/// Limits of the end: for threads, and for the last lines.
const STOP_TIMEOUT: Duration = Duration::from_millis(800);
const LAST_LINES_TIMEOUT: Duration = Duration::from_millis(500);

/// Runs until all recordings end or the caller stops it. `ready` gets the address of the metrics.
///
/// # Errors
/// The run has other views, a source can never be used, or an output cannot be opened or takes no more lines.
pub fn estimate(
    options: Options,
    output: Box<dyn Write + Send>,
    is_stopped: &dyn Fn() -> bool,
    ready: &dyn Fn(Option<std::net::SocketAddr>),
) -> Result<()> {
    options.check()?;
    let clocks = Clocks::of(&options)?;
    let run = options.run.blake3().to_string();
    let metrics = Arc::new(Metrics::new(run.clone(), options.run.views()));
    let shared = Arc::new(Shared::of(&options, metrics.clone()));
    let serve = |address| metrics_server::serve(address, metrics.clone(), shared.clock);
    let address = options.metrics.map(serve).transpose()?;
    let is_timed = shared.pace != Pace::AsFastAsPossible;
    let lines = Lines::to(output, metrics.clone(), is_timed)?;
    let views = Views::start(&options.run, options.searcher, &options.sources, &shared)?;
    ready(address);
    let sources = views.all.iter();
    let sources = sources.filter_map(|view| Some((view.name.clone(), view.source.clone()?)));
    lines.put(Line::Event(Event::Start {
        time_s: 0.0,
        run,
        estimator: options.run.estimator().into(),
        sources: sources.collect(),
    }));
    let count = views.all.len();
    let mut conductor = Conductor {
        pairing: Pairing::new(count, shared.pace == Pace::AsFastAsPossible),
        motions: (0..count).map(|_| TrackMotion::default()).collect(),
        clocks,
        offsets: vec![Correction::default(); count],
        right: 0,
        answers: Answers::new(options.run.views().to_vec(), shared.pace),
        run: options.run,
        news: vec![ViewNews::default(); count],
        has_finished: views.all.iter().map(|view| view.source.is_none()).collect(),
        last_s: None,
        seen: None,
        received_s: 0.0,
        predicted_s: 0.0,
        overload: Overload::of(count),
        withheld: vec![WithheldNews::default(); count],
        backgrounds: vec![None; count],
        placed: vec![0; count],
        shown: vec![Shown::Usual; count],
        serves_metrics: address.is_some(),
        views,
        lines,
        metrics,
        shared,
    };
    for (view, offset_s) in &options.offsets_s {
        let (view, offset_s) = (view.clone(), *offset_s);
        conductor.event(Event::Offset {
            time_s: conductor.event_time_s(),
            view,
            offset_s: Some(offset_s),
            sd_s: None,
            drift_ppm: None,
            drift_sd_ppm: None,
        });
    }
    let cause = conductor.work(is_stopped);
    conductor.finish(cause?)
}

/// A tick: its time, and when its images were taken and received.
#[derive(Debug, Clone, Copy)]
struct LastTick {
    time_s: f64,
    taken_s: f64,
    received_s: f64,
}

struct Conductor {
    run: OnlineRun,
    views: Views,
    shared: Arc<Shared>,
    metrics: Arc<Metrics>,
    lines: Lines,
    /// Images that must not be measured have no content.
    pairing: Pairing<Option<Box<Searched>>>,
    motions: Vec<TrackMotion>,
    clocks: Clocks,
    /// Corrections that bring each view's clock to the first view's time.
    offsets: Vec<Correction>,
    /// The view whose clock is right.
    right: usize,
    answers: Answers,
    news: Vec<ViewNews>,
    has_finished: Vec<bool>,
    last_s: Option<f64>,
    seen: Option<LastTick>,
    /// When the last image came, seconds since the start.
    received_s: f64,
    /// When aircraft were predicted without images, seconds since the start.
    predicted_s: f64,
    overload: Overload,
    withheld: Vec<WithheldNews>,
    /// Backgrounds with the times of their last images and how often the camera had been turned, until the tick that shows them.
    backgrounds: Vec<Option<(f64, u32, Background)>>,
    /// Number of turns of each camera up to its last comparison with the training. A camera that turned since then does not count.
    placed: Vec<u32>,
    /// Result of the last comparison of each camera.
    shown: Vec<Shown>,
    serves_metrics: bool,
}

impl Conductor {
    /// Works until the end, and returns its cause.
    fn work(&mut self, is_stopped: &dyn Fn() -> bool) -> Result<&'static str> {
        loop {
            let mut message = match self.views.messages.recv_timeout(WAIT) {
                Ok(message) => Some(message),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return Ok("recordings"),
            };
            while let Some(content) = message {
                self.take(content)?;
                message = self.views.messages.try_recv().ok();
            }
            self.judge_views();
            let now_s = self.shared.clock.now_s();
            while let Some(joined) = self.pairing.next(now_s) {
                self.tick(joined);
            }
            self.predict();
            self.report_overload();
            if is_stopped() {
                return Ok("signal");
            }
            if self.has_finished.iter().all(|finished| *finished) {
                return Ok("recordings");
            }
            // Without lines and metrics there is no output left.
            if !self.lines.has_reader()? && !self.serves_metrics {
                return Ok("reader");
            }
        }
    }

    fn take(&mut self, message: Message) -> Result<()> {
        match message {
            Message::Searched(view, mut searched) => {
                if let Some(background) = searched.looked.background.take() {
                    self.backgrounds[view] = Some((searched.time_s, searched.turns, background));
                }
                let seen = searched.looked.boxes.iter().filter(|found| found.counts);
                let seen = seen.map(|found| (found.track, &found.pixel_box));
                self.motions[view].take(searched.time_s, seen);
                let now_s = self.shared.clock.now_s();
                self.received_s = now_s;
                let time_s = searched.time_s;
                self.pairing.put(view, time_s, now_s, Some(searched));
            }
            Message::Skipped(view, time_s) => {
                let now_s = self.shared.clock.now_s();
                self.pairing.put(view, time_s, now_s, None);
            }
            Message::Failed(error) => return Err(error),
            Message::Finished(view) => self.has_finished[view] = true,
            Message::Report(view, Report::Useless(why)) => {
                let View { name, source, .. } = &self.views.all[view];
                return Err(Error::View {
                    view: name.clone(),
                    source: source.clone().unwrap_or_default(),
                    why,
                });
            }
            Message::Report(view, report) => {
                if matches!(report, Report::Lost(_)) {
                    self.metrics.count_reopened(view);
                }
                if matches!(report, Report::FirstImage { .. }) {
                    self.clocks.connected(view, self.last_s.unwrap_or(0.0));
                }
                self.news[view].take(report);
            }
        }
        Ok(())
    }

    /// Tells of views whose state has changed.
    fn judge_views(&mut self) {
        let is_timed = self.shared.pace != Pace::AsFastAsPossible;
        let (now_s, event_s) = (self.shared.clock.now_s(), self.event_time_s());
        for view in 0..self.views.all.len() {
            let status = self.views.all[view].status.clone();
            let watch = lock(&status);
            let state = if is_timed {
                watch.state(now_s)
            } else {
                watch.state_at_last_image()
            };
            let delivers = if is_timed {
                state.can_be_measured() && !self.news[view].has_ended()
            } else {
                !self.has_finished[view]
            };
            self.pairing.set_live(view, delivers);
            self.metrics.set_state(view, state);
            let of_view = &self.views.all[view];
            if of_view.source.is_none() {
                continue;
            }
            let why_late = || watch.why_late(now_s);
            if let Some(event) = self.news[view].of(event_s, &of_view.name, state, why_late) {
                self.event(event);
            }
        }
    }

    /// Passes simultaneous images to the estimator.
    fn tick(&mut self, joined: Joined<Option<Box<Searched>>>) {
        let images = joined.images.into_iter();
        let images = images.map(|image| image.and_then(|(time_s, seen)| Some((time_s, seen?))));
        let joined = Joined {
            time_s: joined.time_s,
            images: images.collect(),
        };
        if self.last_s.is_some_and(|last_s| joined.time_s <= last_s) {
            return;
        }
        self.last_s = Some(joined.time_s);
        let mut views: Vec<SeenView> = (0..joined.images.len())
            .map(|view| self.seen_view(&joined, view))
            .collect();
        self.compare_cameras(&joined);
        let mut sees: Vec<Sees> = (0..views.len())
            .map(|view| self.sees(&joined, view))
            .collect();
        for view in 1..views.len() {
            self.watch_clock(&joined, view, &mut views);
        }
        self.leave_out_other_times(&mut views, &mut sees);
        let tick = SeenTick {
            time_ns: nanoseconds(joined.time_s),
            is_recorded: (0..views.len()).all(|view| self.shared.tie(view) == Tie::Common),
            views,
        };
        let images = || joined.images.iter().flatten().map(|(_, searched)| searched);
        let oldest_s = images().map(|searched| searched.taken_s);
        let taken_s = oldest_s.fold(self.shared.clock.now_s(), f64::min);
        let latest = |of: fn(&Searched) -> f64| {
            images()
                .map(|searched| of(searched))
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let (arrival_s, searched_s) = (
            latest(|searched| searched.arrival_s),
            latest(|searched| searched.searched_s),
        );
        self.seen = Some(LastTick {
            time_s: joined.time_s,
            taken_s,
            received_s: self.received_s,
        });
        self.answer(&tick, &sees, joined.time_s, taken_s);
        let now_s = self.shared.clock.now_s();
        if images().next().is_some() {
            self.metrics.time(Stage::Join, now_s - searched_s);
            self.metrics.time(Stage::Total, now_s - arrival_s);
        }
    }

    /// Compares the backgrounds that are complete at this tick, and tells of cameras that do not look as in the training, or do so again.
    fn compare_cameras(&mut self, joined: &Joined<Box<Searched>>) {
        for view in 0..self.backgrounds.len() {
            let image = joined.images[view].as_ref();
            let until_s = image.map_or(joined.time_s, |(time_s, _)| time_s.max(joined.time_s));
            let Some((_, turns, background)) =
                self.backgrounds[view].take_if(|(time_s, ..)| *time_s <= until_s)
            else {
                continue;
            };
            let shown = self.run.show(view, &background);
            if matches!(shown, Shown::Usual | Shown::Moved(_))
                && std::mem::replace(&mut self.placed[view], turns) != turns
            {
                self.clocks.turned(view);
            }
            if [&shown, &self.shown[view]] != [&Shown::Usual; 2] {
                self.event(Event::Camera {
                    time_s: joined.time_s,
                    view: self.views.all[view].name.clone(),
                    surroundings: Surroundings::of(&shown),
                });
            }
            self.shown[view] = shown;
        }
    }

    /// Content of a view at a tick, before clocks are compared.
    fn sees(&self, joined: &Joined<Box<Searched>>, view: usize) -> Sees {
        let image = joined.images[view].as_ref();
        let Some((_, searched)) = image.filter(|(_, searched)| best_of(searched).is_some()) else {
            return Sees::Nothing;
        };
        match self.shown[view] {
            Shown::OtherView(_) => Sees::LeftOut(Reason::OtherView),
            Shown::Elsewhere => Sees::LeftOut(Reason::Elsewhere),
            _ if searched.turns != self.placed[view] => Sees::LeftOut(Reason::Turned),
            Shown::Usual | Shown::Moved(_) | Shown::Unknown => Sees::Aircraft,
        }
    }

    /// The view's boxes, moved to the tick's time.
    fn seen_view(&self, joined: &Joined<Box<Searched>>, view: usize) -> SeenView {
        let Some((time_s, searched)) = &joined.images[view] else {
            return SeenView::default();
        };
        if searched.turns != self.placed[view] {
            return SeenView {
                look: Look::Blind,
                ..SeenView::default()
            };
        }
        let moved = |track: u32| self.motions[view].moved_px(track, joined.time_s - time_s);
        let reference = joined.images[0].as_ref().filter(|_| view > 0);
        let registration = reference.and_then(|(_, first)| {
            let cameras = [0, view].map(|view| self.run.camera(view));
            let patches = [&first.looked.patch, &searched.looked.patch];
            let shift = register_views([&cameras[0], &cameras[1]], patches);
            let moved_px = best_of(searched).map_or([0.0; 2], |best| moved(best.track));
            Some((0, moved_shift(shift.ok()?, moved_px)))
        });
        let counting = searched.looked.boxes.iter().filter(|found| found.counts);
        let boxes = counting.map(|found| Candidate {
            pixel_box: moved_box(found.pixel_box, moved(found.track)),
            score: found.score,
            track: Some(found.track),
        });
        SeenView {
            look: Look::of(searched.looked.camera),
            boxes: boxes.collect(),
            registration,
            common_sd_px: [0.0; 2],
        }
    }

    /// Compares the view's clock with the first one's. Once the offset is known, its error widens the intervals.
    fn watch_clock(&mut self, joined: &Joined<Box<Searched>>, view: usize, views: &mut [SeenView]) {
        let Some((time_s, searched)) = &joined.images[view] else {
            return;
        };
        let ties = [0, view].map(|view| self.shared.tie(view));
        let tie = ties[0].max(ties[1]);
        if tie == Tie::Common {
            return;
        }
        let first = joined.images[0].as_ref();
        let first_added_s = first.map_or(0.0, |(_, first)| first.added_s);
        // By the first view's own clock.
        let own_s = joined.time_s - first_added_s;
        let is_sighted = !views[0].boxes.is_empty() && !views[view].boxes.is_empty();
        let shift = views[view].registration.filter(|_| is_sighted);
        let sighting = shift.zip(best_of(searched)).map(|((_, shift), best)| {
            // Where it was in the image: a motion that is known too little would be an error of the offset.
            let later_s = time_s - joined.time_s;
            let moved_px = DVec2::from(self.motions[view].moved_px(best.track, -later_s));
            let here_px = DVec2::new(shift.x_px, shift.y_px);
            let there_px = here_px + DVec2::new(shift.dx_px, shift.dy_px) - moved_px;
            Sighting {
                time_s: own_s,
                places_px: [here_px, there_px],
                width_px: best.pixel_box.width_px,
                sd_px: across_sd_px(best.pixel_box.width_px),
                taken_off_s: first_added_s + later_s - searched.added_s,
            }
        });
        let news = first.and_then(|_| self.clocks.take((view, tie), own_s, sighting));
        if self.clocks.is_known(view) {
            let error_s = self.clocks.error_s(view, own_s);
            let motion = best_of(searched).map(|best| self.motions[view].px_s(best.track));
            views[view].common_sd_px = motion.unwrap_or_default().map(|px_s| px_s * error_s);
        }
        match news {
            None => {}
            Some(News::Unknown) => {
                let vague = self.clocks.best(view, own_s);
                self.correct(
                    view,
                    vague.map(|of| correction(of, own_s)).unwrap_or_default(),
                );
                self.report_offset(if ties[1] < ties[0] { 0 } else { view }, None);
            }
            Some(News::Known(offset)) => self.correct_by(view, offset, own_s),
        }
    }

    /// Leaves out views whose times cannot be compared with the other views'.
    fn leave_out_other_times(&self, views: &mut [SeenView], sees: &mut [Sees]) {
        let clocks = (0..views.len()).map(|view| ComparedClock {
            tie: self.shared.tie(view),
            is_known: self.clocks.is_known(view),
            sees_aircraft: !views[view].boxes.is_empty(),
        });
        for view in out_of_time(&clocks.collect::<Vec<_>>()) {
            views[view] = SeenView::default();
            if sees[view] == Sees::Aircraft {
                sees[view] = Sees::LeftOut(Reason::Clock);
            }
        }
    }

    /// Corrects all clocks after a view's offset from the first one is known, or a different one. Returns the view whose clock is right.
    fn correct(&mut self, view: usize, offset: Correction) -> usize {
        self.offsets[view] = offset;
        let now_s: Vec<f64> = (self.offsets.iter())
            .map(|of| of.at(offset.time_s))
            .collect();
        self.right = right_clock(&self.shared.delays_s(), &now_s, self.right);
        let of_right = self.offsets[self.right];
        for (view, of_view) in self.offsets.iter().enumerate() {
            self.shared.correct(view, of_view.without(&of_right));
        }
        self.right
    }

    /// Corrects the clock that is wrong, and tells of it.
    fn correct_by(&mut self, view: usize, offset: Offset, time_s: f64) {
        if self.correct(view, correction(offset, time_s)) == view {
            self.report_offset(0, Some(offset.back()));
        } else {
            self.report_offset(view, Some(offset));
        }
    }

    fn report_offset(&self, view: usize, offset: Option<Offset>) {
        let view = self.views.all[view].name.clone();
        self.event(Event::Offset {
            time_s: self.event_time_s(),
            view,
            offset_s: offset.map(|offset| offset.offset_s),
            sd_s: offset.map(|offset| offset.sd_s),
            drift_ppm: offset.map(|offset| offset.drift_ppm),
            drift_sd_ppm: offset.map(|offset| offset.drift_sd_ppm),
        });
    }

    /// Predicts the aircraft while no images come, with the lag that the last ones had, so that the next ones are later.
    fn predict(&mut self) {
        let now_s = self.shared.clock.now_s();
        let (Some(seen), Some(last_s)) = (self.seen, self.last_s) else {
            return;
        };
        let is_timed = self.shared.pace != Pace::AsFastAsPossible;
        let silent_s = now_s - seen.received_s.max(self.received_s);
        if !is_timed || silent_s < MAX_FRESH_S || now_s < self.predicted_s + MAX_FRESH_S {
            return;
        }
        let since_s = now_s - seen.received_s;
        let time_s = seen.time_s + since_s;
        if time_s <= last_s {
            return;
        }
        self.predicted_s = now_s;
        self.last_s = Some(time_s);
        let views = (0..self.views.all.len()).map(|_| SeenView::default());
        let tick = SeenTick {
            time_ns: nanoseconds(time_s),
            views: views.collect(),
            ..SeenTick::default()
        };
        let sees = vec![Sees::Nothing; tick.views.len()];
        self.answer(&tick, &sees, time_s, seen.taken_s + since_s);
    }

    fn answer(&mut self, tick: &SeenTick, sees: &[Sees], time_s: f64, taken_s: f64) {
        let found = self.run.take(tick);
        let now_s = self.shared.clock.now_s();
        let is_of_cameras = self.shared.pace == Pace::Cameras;
        let utc = || self.shared.clock.utc(self.shared.since_start_s(time_s));
        let utc = is_of_cameras.then(utc);
        let event_s = self.event_time_s();
        for (view, sees) in sees.iter().enumerate() {
            let name = &self.views.all[view].name;
            let seen = (*sees, self.run.unlike().contains(&view));
            let news = self.withheld[view].next(event_s, (name, view), seen, &found);
            news.into_iter().for_each(|event| self.event(event));
        }
        for answer in self
            .answers
            .of(found, time_s, utc, (now_s - taken_s).max(0.0))
        {
            self.metrics.answered(answer.state, now_s);
            self.lines.put(Line::Answer(Box::new(answer)));
        }
    }

    fn event(&self, event: Event) {
        self.lines.put(Line::Event(event));
    }

    /// Time of an event now, in the time of answers.
    fn event_time_s(&self) -> f64 {
        let now_s = self.shared.answer_time_s(self.shared.clock.now_s());
        now_s.or(self.last_s).unwrap_or(0.0)
    }

    fn report_overload(&mut self) {
        let times_s = [self.shared.clock.now_s(), self.event_time_s()];
        let mut names = self.views.all.iter().map(|view| &view.name);
        if let Some(event) = self.overload.news(times_s, &self.metrics, &mut names) {
            self.event(event);
        }
    }

    fn finish(mut self, cause: &'static str) -> Result<()> {
        for (view, offset) in self.clocks.at_end() {
            self.correct_by(view, offset, self.last_s.unwrap_or(0.0));
        }
        let images = self.views.all.iter().enumerate();
        let images = images.map(|(view, of_view)| {
            let searched = self.metrics.images(view, Fate::Searched);
            let others = self.metrics.all_images(view) - searched;
            (of_view.name.clone(), searched, others)
        });
        let images = images.collect();
        self.event(Event::End {
            time_s: self.event_time_s(),
            cause,
            images,
        });
        self.views.stop(STOP_TIMEOUT);
        self.lines.finish(LAST_LINES_TIMEOUT)
    }
}

fn correction(offset: Offset, time_s: f64) -> Correction {
    Correction {
        seconds: offset.offset_s,
        time_s,
        drift: offset.drift_ppm * 1e-6,
    }
}

fn best_of(searched: &Searched) -> Option<&SeenBox> {
    let counting = searched.looked.boxes.iter().filter(|found| found.counts);
    counting.max_by(|a, b| a.score.total_cmp(&b.score))
}

fn nanoseconds(time_s: f64) -> i64 {
    (time_s * 1e9).round() as i64
}
