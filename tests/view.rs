//! `dtd view` from outside: what its page is told is what the corpus says, nobody else is answered, no request leaves the corpus, and a
//! corpus in any state shows what there is. What a browser makes of it is judged by tests/judges/view_page.py, in Chromium.

mod tiny;

use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
use std::net::TcpStream;

use dataset::corpus::Corpus;
use image::RgbImage;
use serde_json::{Value, json};
use testkit::command::{Ending, Server};
use testkit::judge_in_chromium;
use tiny::{SCENARIOS, Tiny};
use zune_jpeg::{JpegDecoder, zune_core::bytestream::ZCursor};

/// A folder's server.
struct Page {
    server: Server,
}

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Page {
    fn of(tiny: &Tiny, arguments: &[&str]) -> Self {
        let fixed = ["view", "corpus", "--port", "0"];
        let alone = ["--no-open", "--until-stdin-ends"];
        let server = Server::start(&mut tiny.dtd(&[&fixed[..], &alone, arguments].concat()));
        Self { server }
    }

    /// Asks for a target as it is, with further headers.
    fn ask(&self, target: &str, headers: &str) -> Answer {
        let address = self.server.address("address");
        self.send(&format!(
            "GET {target} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n"
        ))
    }

    fn send(&self, request: &str) -> Answer {
        let mut stream = TcpStream::connect(self.server.address("address")).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n");
        let end = end.unwrap_or_else(|| panic!("{}", String::from_utf8_lossy(&bytes)));
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        Answer {
            status: head[9..12].parse().unwrap(),
            body: bytes.split_off(end + 4),
            head: head.to_lowercase(),
        }
    }

    fn json(&self, target: &str) -> Value {
        let answer = self.ask(target, "");
        assert_eq!(answer.status, 200, "{target}: {}", answer.text());
        serde_json::from_slice(&answer.body).unwrap()
    }

    fn thumbnail(&self, id: &str) -> Answer {
        self.ask(&format!("/thumbnail?scenario={id}"), "")
    }

    fn scenario(&self, id: &str) -> Value {
        self.json(&format!("/api/scenario?scenario={id}"))
    }

    /// A scenario's row in the overview.
    fn row(&self, id: &str) -> Value {
        let rows = self.json("/api/corpus")["scenarios"].take();
        let mut rows = rows.as_array().unwrap().iter();
        rows.find(|row| row["id"] == id).unwrap().clone()
    }
}

impl Answer {
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    fn image(&self) -> RgbImage {
        assert_eq!(self.status, 200, "{}", self.text());
        assert!(self.head.contains("content-type: image/jpeg"));
        let mut jpeg = JpegDecoder::new(ZCursor::new(&self.body));
        let rgb = jpeg.decode().unwrap();
        let (width, height) = jpeg.dimensions().unwrap();
        RgbImage::from_raw(width as u32, height as u32, rgb).unwrap()
    }
}

fn numbers(column: &Value) -> Vec<f64> {
    let numbers = column.as_array().unwrap().iter();
    numbers.map(|number| number.as_f64().unwrap()).collect()
}

fn assert_near(found: &[f64], expected: impl Iterator<Item = f64>) {
    let expected: Vec<f64> = expected.collect();
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let off = (found - expected).abs();
        assert!(off <= 5.1e-4, "{found}, expected {expected}");
    }
}

#[test]
fn the_page_is_told_what_the_corpus_and_the_run_say() {
    let tiny = Tiny::made();
    let page = Page::of(tiny, &["--run", "run"]);
    assert!(page.ask("/", "").text().contains("<title>dtd view</title>"));
    let overview = page.json("/api/corpus");
    let rows = overview["scenarios"].as_array().unwrap();
    assert_eq!(rows.len(), SCENARIOS);
    assert!(
        rows.iter().all(|row| row["state"] == "detected"),
        "{overview}"
    );
    assert_eq!(overview["problems"], json!([]));

    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    for folder in corpus.scenarios().unwrap() {
        let (id, open) = (folder.id(), folder.open().unwrap());
        let row = page.row(&id);
        let side = serde_json::to_value(splits.scenarios[&id].side).unwrap();
        assert_eq!(row["side"], side);
        let told = page.scenario(&id);
        let frames = open.frames().unwrap();
        assert_near(
            &numbers(&told["ticks"]["dtd_m"]),
            frames.rows.iter().map(|row| row.labels.unwrap().dtd_m),
        );
        assert_near(
            &numbers(&told["ticks"]["along_track_m"]),
            frames
                .rows
                .iter()
                .map(|row| row.labels.unwrap().along_track_m),
        );
        let model = &told["models"][0];
        let found = open.detections(model["hash"].as_str().unwrap()).unwrap();
        for view in told["views"].as_array().unwrap() {
            let name = view["id"].as_str().unwrap();
            let truth = open.truth_boxes().unwrap();
            let truth = truth.iter().filter(|real| real.view == name);
            assert_near(
                &numbers(&view["truth"]["cx_px"]),
                truth.map(|real| real.pixel_box.cx_px),
            );
            let found = found.boxes.iter().filter(|found| found.view == name);
            let told = &model["detections"][name]["width_px"];
            assert_near(&numbers(told), found.map(|found| found.pixel_box.width_px));
        }
    }

    let runs = page.json("/api/runs");
    let metrics = fs::read(tiny.path("run/metrics.json")).unwrap();
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    assert_eq!(runs[0]["problems"], json!([]));
    assert!(runs[0]["recommended"].is_string());
    let estimators = metrics["estimators"].as_object().unwrap();
    for (name, figures) in estimators {
        let told = &runs[0]["metrics"]["estimators"][name];
        assert_eq!(told["mape_pct"], figures["mape_pct"], "{name}");
        for flight in figures["by_flight"].as_array().unwrap() {
            let id = flight["scenario"].as_str().unwrap();
            let told = &runs[0]["flights"][id][name];
            if let Some(expected) = flight["mape_pct"].as_f64() {
                let by_nm = told["by_nm"].as_object().unwrap().values();
                let [sum_pct, answers] = by_nm.fold([0.0; 2], |sums, bin| {
                    [0, 1].map(|index| sums[index] + bin[index].as_f64().unwrap())
                });
                let found = [told["mape_pct"].as_f64().unwrap(), sum_pct / answers];
                assert_near(&found, [expected; 2].into_iter());
            }
        }
    }
    page.server.end();
}

#[test]
fn every_picture_is_that_of_its_tick_in_any_order_and_videos_come_in_parts() {
    let tiny = Tiny::made();
    let page = Page::of(tiny, &[]);
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let folder = corpus.scenarios().unwrap().remove(0);
    let (id, open) = (folder.id(), folder.open().unwrap());
    let record = open.record().unwrap();
    for view in &record.views {
        let mut reader = open.open_video(view).unwrap();
        let (mut rgb, mut pictures) = (Vec::new(), Vec::new());
        while reader.next_frame(&mut rgb).unwrap().is_some() {
            pictures.push(rgb.clone());
        }
        let last = record.ticks - 1;
        for tick in (0..=last).rev().chain([0, last, 1]) {
            let target = format!("/frame?scenario={id}&view={view}&tick={tick}");
            let answer = page.ask(&target, "");
            assert!(answer.head.contains("content-type: image/bmp"));
            let mut pixels = answer.body[54..].to_vec();
            for pixel in pixels.chunks_exact_mut(3) {
                pixel.swap(0, 2);
            }
            // Rows of 480 pixels need no padding.
            assert!(pixels == pictures[tick as usize], "tick {tick} of {view}");
        }
        let beyond = format!("/frame?scenario={id}&view={view}&tick={}", record.ticks);
        assert_eq!(page.ask(&beyond, "").status, 404);

        // Reduced for the screen: fewer columns, and a part with all columns.
        let mut reader = open.open_video(view).unwrap();
        reader.skip_frame().unwrap();
        let planes = reader.planes().unwrap().unwrap();
        let target = format!("/frame?scenario={id}&view={view}&tick=0&as=planes");
        let whole = page.ask(&target, "");
        assert!(whole.head.contains("picture-size: 480x320\r"));
        assert!(whole.body == planes);
        let shown = page.ask(&format!("{target}&every=2&part=2,4,40,20"), "");
        let head = &shown.head;
        assert!(head.contains("picture-size: 240x160 40x20"), "{head}");
        assert_eq!(shown.body.len(), (240 * 160 + 40 * 20) * 3 / 2);
        let part = &shown.body[240 * 160 * 3 / 2..];
        assert_eq!(part[..40], planes[4 * 480 + 2..][..40]);
        for wrong in ["every=0", "every=17", "part=1,0,2,2", "part=0,0,482,2"] {
            let answer = page.ask(&format!("{target}&{wrong}"), "");
            assert_eq!(answer.status, 400, "{wrong}: {}", answer.text());
        }

        let video = fs::read(folder.video_path(view)).unwrap();
        let target = format!("/video?scenario={id}&view={view}");
        let whole = page.ask(&target, "");
        assert!(whole.status == 200 && whole.body == video);
        assert!(whole.head.contains("accept-ranges: bytes"));
        let part = page.ask(&target, "Range: bytes=10-99\r\n");
        assert!(part.status == 206 && part.body == video[10..100]);
        let range = format!("content-range: bytes 10-99/{}", video.len());
        assert!(part.head.contains(&range), "{}", part.head);
        let beyond = format!("Range: bytes={}-\r\n", video.len());
        assert_eq!(page.ask(&target, &beyond).status, 416);
    }
}

#[test]
fn nobody_else_is_answered_and_no_request_leaves_the_corpus() {
    let tiny = Tiny::made();
    let page = Page::of(tiny, &["--run", "run"]);
    let address = page.server.address("address");
    assert!(address.ip().is_loopback());
    for (headers, status) in [
        (format!("Host: {address}\r\n"), 200),
        (format!("Host: localhost:{}\r\n", address.port()), 200),
        // Through a tunnel (`ssh -L 9000:localhost:4180`).
        ("Host: localhost:9000\r\n".to_owned(), 200),
        (
            "Host: localhost:9000\r\nOrigin: http://localhost:9000\r\n".to_owned(),
            200,
        ),
        (
            "Host: localhost:9000\r\nOrigin: http://localhost:3000\r\n".to_owned(),
            403,
        ),
        (
            format!("Host: {address}\r\nOrigin: http://{address}\r\n"),
            200,
        ),
        ("Host: evil.example\r\n".to_owned(), 403),
        (format!("Host: evil.example:{}\r\n", address.port()), 403),
        (
            format!("Host: {address}\r\nOrigin: http://evil.example\r\n"),
            403,
        ),
        (format!("Host: {address}\r\nOrigin: null\r\n"), 403),
    ] {
        let request = format!("GET /api/corpus HTTP/1.1\r\nConnection: close\r\n{headers}\r\n");
        let answer = page.send(&request);
        assert_eq!(answer.status, status, "{headers}");
        assert_eq!(
            answer.text().contains("scenarios"),
            status == 200,
            "{headers}"
        );
    }
    let post = format!("POST / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    assert_eq!(page.send(&post).status, 405);

    let id = &tiny.scenarios()[0];
    let id = id.file_name().unwrap().to_str().unwrap();
    for target in [
        "/../../../../etc/passwd".to_owned(),
        "/%2e%2e/%2e%2e/etc/passwd".to_owned(),
        "/video?scenario=../../..&view=left".to_owned(),
        "/video?scenario=..%2F..%2Frun&view=left".to_owned(),
        format!("/video?scenario={id}&view=../scenario.json"),
        format!("/video?scenario={id}&view=..%2f..%2f..%2fplan"),
        format!("/frame?scenario={id}&view=%2Fetc%2Fpasswd&tick=0"),
        "/api/scenario?scenario=%00".to_owned(),
        "/api/scenario?scenario=%3Cscript%3E".to_owned(),
        format!("/api/path?scenario={id}.partial"),
        "/api/scenario".to_owned(),
    ] {
        let answer = page.ask(&target, "");
        assert!(
            [400, 404].contains(&answer.status),
            "{target}: {}",
            answer.status
        );
        assert!(
            answer.head.contains("content-type: application/json"),
            "{target}"
        );
        assert!(
            answer.head.contains("x-content-type-options: nosniff"),
            "{target}"
        );
        assert!(!answer.text().contains("root:"), "{target}");
    }
    // A planted link leads nowhere, either.
    let tiny = Tiny::made().copy();
    let link = tiny.corpus().join("scenarios/linked");
    std::os::unix::fs::symlink(tiny.scenarios()[0].canonicalize().unwrap(), &link).unwrap();
    let page = Page::of(&tiny, &[]);
    assert_eq!(page.row("linked")["state"], "damaged");
    let answer = page.ask("/api/scenario?scenario=linked", "");
    assert!(answer.text().contains("symbolic link"), "{}", answer.text());
}

#[test]
fn a_person_who_is_refused_gets_a_page_with_the_command_that_helps() {
    let page = Page::of(Tiny::made(), &[]);
    let port = page.server.address("address").port();
    let open = |host: &str, target: &str, accept: &str| {
        page.send(&format!(
            "GET {target} HTTP/1.1\r\nHost: {host}\r\nAccept: {accept}\r\nConnection: close\r\n\r\n"
        ))
    };
    let browser = "text/html,application/xhtml+xml,*/*;q=0.8";
    let refused = open("evil.example:4180", "/", browser);
    assert_eq!(refused.status, 403);
    assert!(refused.head.contains("content-type: text/html"));
    let policy = "content-security-policy: default-src 'none'; style-src 'unsafe-inline'";
    assert!(refused.head.contains(policy), "{}", refused.head);
    let text = refused.text();
    let command = format!("ssh -L {port}:127.0.0.1:{port} USER@COMPUTER");
    for words in [
        "DNS rebinding",
        &command,
        &format!("http://localhost:{port}/"),
    ] {
        assert!(text.contains(words), "{words:?} is not in {text}");
    }
    let hostile = open("<script>", "/", browser).text();
    assert!(hostile.contains("&lt;script&gt;") && !hostile.contains("<script"));

    let absent = open("localhost:9000", "/nowhere", browser);
    assert_eq!(absent.status, 404);
    assert!(absent.text().contains("there is nothing at this address"));
    assert!(!absent.text().contains("ssh"));
    // Scripts get JSON, as before.
    let script = open("evil.example", "/api/corpus", "*/*");
    assert!(script.head.contains("content-type: application/json"));
}

#[test]
fn a_thumbnail_shows_the_aircraft_where_it_is_nearest_and_whole() {
    let tiny = Tiny::made();
    let page = Page::of(tiny, &[]);
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    for folder in corpus.scenarios().unwrap() {
        let (id, open) = (folder.id(), folder.open().unwrap());
        let answer = page.thumbnail(&id);
        let shown = answer.image();
        let truth = open.truth_boxes().unwrap();
        let whole = truth.iter().filter(|real| real.visible_fraction >= 0.99);
        let nearest = whole.max_by(|a, b| a.pixel_box.area().total_cmp(&b.pixel_box.area()));
        let nearest = nearest.unwrap();
        let picture = open.picture(&nearest.view, nearest.tick).unwrap();
        let [width, height] = picture.size_px;
        assert!(shown.width() < width && shown.height() < height);
        let start = |centre: f64, length: u32, side: u32| {
            (centre - f64::from(length) / 2.0).clamp(0.0, f64::from(side - length)) as u32
        };
        let aircraft = nearest.pixel_box;
        let left = start(aircraft.cx_px, shown.width(), width);
        let top = start(aircraft.cy_px, shown.height(), height);
        let [from_x, from_y, to_x, to_y] = aircraft.edges().map(|edge| edge.max(0.0) as u32);
        let mut differences = Vec::new();
        for (x, y) in (from_x..to_x).flat_map(|x| (from_y..to_y).map(move |y| (x, y))) {
            let expected = &picture.rgb[(y * width + x) as usize * 3..][..3];
            let found = shown.get_pixel(x - left, y - top).0;
            let pairs = found.iter().zip(expected);
            differences.extend(pairs.map(|(found, expected)| f64::from(found.abs_diff(*expected))));
        }
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        assert!(mean < 12.0, "{id}: differs by {mean} from the aircraft");
        assert!(page.thumbnail(&id).body == answer.body);
    }
    for (target, status) in [
        ("scenario=nowhere", 404),
        ("scenario=..%2F..", 404),
        ("", 400),
    ] {
        let answer = page.ask(&format!("/thumbnail?{target}"), "");
        assert_eq!(answer.status, status, "{target}");
    }
}

#[test]
fn a_corpus_in_the_making_damaged_or_without_labels_shows_what_there_is() {
    let tiny = Tiny::made().copy();
    let scenarios = tiny.scenarios();
    let name = |index: usize| scenarios[index].file_name().unwrap().to_str().unwrap();
    let (unlabelled, partial, failed, damaged) = (name(0), name(1), name(2), name(3));
    let without_pictures = name(4);
    let again = [
        "generate",
        "sweep.toml",
        "--out",
        "bare",
        "--only",
        unlabelled,
    ];
    tiny.dtd(&again).succeeds();
    fs::remove_dir_all(&scenarios[0]).unwrap();
    fs::rename(tiny.path("bare/scenarios").join(unlabelled), &scenarios[0]).unwrap();
    // As a kill leaves a recording.
    fs::remove_file(scenarios[1].join("DONE.json")).unwrap();
    fs::rename(&scenarios[1], scenarios[1].with_extension("partial")).unwrap();
    fs::remove_dir_all(&scenarios[2]).unwrap();
    fs::create_dir_all(tiny.corpus().join("failed")).unwrap();
    let record = json!({ "id": failed, "config_hash": "0", "reasons": ["<b>no fuel</b>", "fog"] });
    let path = tiny.corpus().join(format!("failed/{failed}.json"));
    fs::write(path, record.to_string()).unwrap();
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    for (id, view) in [
        (damaged, "left"),
        (without_pictures, "left"),
        (without_pictures, "right"),
    ] {
        let video = corpus.scenario(id).video_path(view);
        let mut file = File::options().write(true).open(video).unwrap();
        file.seek(SeekFrom::Start(2_000)).unwrap();
        file.write_all(&[0; 64]).unwrap();
    }
    let hostile = "<script>alert(1)<:script>";
    fs::create_dir(tiny.corpus().join("scenarios").join(hostile)).unwrap();

    let page = Page::of(&tiny, &[]);
    assert_eq!(page.row(unlabelled)["state"], "recorded");
    let told = page.scenario(unlabelled);
    assert_eq!(told["ticks"]["dtd_m"], Value::Null);
    assert!(told["ticks"]["along_track_m"][0].as_f64().unwrap() > 1_000.0);
    assert_eq!(
        (&told["models"], &told["views"][0]["truth"]),
        (&json!([]), &Value::Null)
    );

    // Without labels or detections, the whole last image.
    let last = page.thumbnail(unlabelled).image();
    assert_eq!(last.dimensions(), (480, 320));
    let refused = page.thumbnail(without_pictures);
    assert_eq!(refused.status, 422);
    assert!(
        refused.text().contains("does not match its seal"),
        "{}",
        refused.text()
    );

    assert_eq!(page.row(partial)["state"], "recording");
    assert_eq!(page.row(partial)["views"], json!(["left", "right"]));
    assert!(page.row(partial)["unchanged_s"].is_u64());
    assert_eq!(
        page.ask(&format!("/api/scenario?scenario={partial}"), "")
            .status,
        404
    );

    assert_eq!(page.row(failed)["state"], "failed");
    assert_eq!(page.row(failed)["faults"], json!(["<b>no fuel</b>", "fog"]));

    // The tables and one video are intact.
    let frame = |view| page.ask(&format!("/frame?scenario={damaged}&view={view}&tick=1"), "");
    assert!(page.scenario(damaged)["ticks"]["dtd_m"][0].is_number());
    assert_eq!(frame("right").status, 200);
    assert_eq!(frame("left").status, 422);
    assert!(frame("left").text().contains("does not match its seal"));

    let row = page.row(hostile);
    assert_eq!(row["state"], "damaged");

    fs::write(tiny.corpus().join("plan.json"), "{").unwrap();
    fs::remove_file(tiny.corpus().join("splits.json")).unwrap();
    assert_eq!(page.row(unlabelled)["state"], "recorded");
    let problems = page.json("/api/corpus")["problems"].to_string();
    assert!(problems.contains("plan.json"), "{problems}");
}

#[test]
fn a_run_that_was_judged_on_another_corpus_with_the_same_names_shows_no_errors() {
    let tiny = Tiny::made().copy();
    let page = Page::of(&tiny, &["--run", "run"]);
    let runs = page.json("/api/runs");
    let flights = runs[0]["flights"].as_object().unwrap();
    let id = flights.keys().next().unwrap();
    page.server.end();

    let sweep = fs::read_to_string(tiny.path("sweep.toml")).unwrap();
    let other = sweep.replace("seed = 5", "seed = 6");
    assert_ne!(other, sweep);
    fs::write(tiny.path("sweep.toml"), other).unwrap();
    fs::rename(tiny.corpus(), tiny.path("judged")).unwrap();
    for arguments in [
        &["generate", "sweep.toml", "--out", "corpus", "--only", id][..],
        &["label", "corpus"],
    ] {
        tiny.dtd(arguments).succeeds();
    }

    let page = Page::of(&tiny, &["--run", "run"]);
    let runs = page.json("/api/runs");
    let run = &runs[0];
    assert_eq!(
        (&run["metrics"], &run["flights"]),
        (&Value::Null, &json!({}))
    );
    let words = format!("was judged on another corpus: its scenario {id} has ");
    let problem = run["problems"][0].as_str().unwrap();
    assert!(problem.starts_with(&words), "{problem}");
    let tables = page.scenario(id);
    assert_eq!(tables["runs"], json!([null]));
    let problem = tables["problems"][0].as_str().unwrap();
    assert!(
        problem.starts_with(&format!("run run {words}")),
        "{problem}"
    );
}

#[test]
fn what_cannot_be_shown_is_refused_before_a_port_is_opened() {
    let tiny = Tiny::made();
    for (arguments, words) in [
        (&["view", "run"][..], "is not a corpus"),
        (
            &["view", "corpus", "--run", "nowhere"],
            "there is no run nowhere",
        ),
        (
            &["view", "corpus", "--run", "run", "--run", "./run/"],
            "is given twice",
        ),
        (&["view", "s3://bucket/corpus"], "dtd fetch"),
    ] {
        tiny.dtd(&[arguments, &["--no-open"]].concat())
            .ends_with(2, &[words]);
    }
    let page = Page::of(tiny, &[]);
    let port = page.server.address("address").port().to_string();
    tiny.dtd(&["view", "corpus", "--no-open", "--port", &port])
        .ends_with(2, &["--port 0"]);
}

#[test]
fn chromium_shows_pictures_steps_zooms_and_restores_and_finds_nothing_inaccessible() {
    let tiny = Tiny::made().copy();
    let hostile = tiny.corpus().join("scenarios/<img src=x onerror=alert(1)>");
    fs::create_dir(hostile).unwrap();
    let page = Page::of(&tiny, &["--run", "run"]);
    let address = page.server.address("address");
    judge_in_chromium("view_page.py", format!("http://{address}/"));
    judge_in_chromium("report_page.py", tiny.path("run/report.html"));
}
