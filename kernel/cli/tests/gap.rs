//! `sagci gap` as a person and a program meet it: what it answers, what it refuses and how, and what it never touches.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

struct Said {
    code: i32,
    out: String,
    err: String,
}

fn sagci(arguments: &[&str]) -> Said {
    let output = Command::new(env!("CARGO_BIN_EXE_sagci")).args(arguments).output().unwrap();
    Said {
        code: output.status.code().unwrap(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

fn measured(file: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/measured");
    root.join(file).canonicalize().unwrap().to_str().unwrap().to_owned()
}

const PENDULUM: &str = r#"<robot name="pendulum"><link name="post"/><link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="post"/><child link="bob"/><axis xyz="0 1 0"/></joint></robot>"#;

const YAML: &str = "schema: 1\nname: pendulum\ndescription: A bob on a rod.\nprovenance:\n  licence: CC0-1.0\n  attribution: nobody\n  \
                    origins:\n    - source: made for a test\n      version: '1'\n";

/// A pendulum of 1 kg at 0.5 m with viscous friction, swinging freely from an angle; RK4, our own step not involved.
fn swing(angle: f64, damping: f64, seconds: f64) -> Vec<[f64; 2]> {
    let acceleration = |q: f64, v: f64| -(9.81 * 0.5 * q.sin() + damping * v) / 0.251;
    let (mut q, mut v, h) = (angle, 0.0, 1e-3);
    let mut noise = 12345u64;
    let mut rows = Vec::new();
    for k in 0..(seconds / h) as usize {
        if k % 10 == 0 {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let even = (noise >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
            rows.push([k as f64 * h, q + 1e-4 * even]);
        }
        let (k1q, k1v) = (v, acceleration(q, v));
        let (k2q, k2v) = (v + 0.5 * h * k1v, acceleration(q + 0.5 * h * k1q, v + 0.5 * h * k1v));
        let (k3q, k3v) = (v + 0.5 * h * k2v, acceleration(q + 0.5 * h * k2q, v + 0.5 * h * k2v));
        let (k4q, k4v) = (v + h * k3v, acceleration(q + h * k3q, v + h * k3v));
        q += h / 6.0 * (k1q + 2.0 * k2q + 2.0 * k3q + k4q);
        v += h / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v);
    }
    rows
}

fn csv(header: &str, rows: &[[f64; 2]]) -> String {
    let mut text = header.to_owned() + "\n";
    for [t, q] in rows {
        writeln!(text, "{t:.3},{q:.8}").unwrap();
    }
    text
}

/// A folder with a pendulum and one recording of it.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let this = Self { folder: tempfile::tempdir().unwrap() };
        this.write("pendulum/object.urdf", PENDULUM);
        this.write("pendulum/model.yaml", YAML);
        this.write("swing.csv", csv("time,pivot.position", &swing(0.9, 0.05, 6.0)));
        this.write("other.csv", csv("time,pivot.position", &swing(0.6, 0.05, 6.0)));
        this
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) -> String {
        let path = self.folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// The pendulum in a library of its own.
    fn library(&self) -> String {
        let models = self.path("models");
        std::fs::create_dir_all(&models).unwrap();
        self.write("models/pendulum/LICENSE", "CC0-1.0");
        let said = sagci(&["models", "add", &self.path("pendulum"), "--models", &models]);
        assert_eq!(said.code, 0, "{}", said.err);
        models
    }

    /// What is refused, says so on stderr with these words, prints nothing on stdout and exits with 2.
    fn refused(&self, arguments: &[&str], words: &[&str]) {
        let model = self.path("pendulum");
        let mut all = vec!["gap", model.as_str()];
        all.extend(arguments);
        refused(&all, words);
    }
}

fn refused(arguments: &[&str], words: &[&str]) {
    let said = sagci(arguments);
    assert_eq!((said.code, said.out.as_str()), (2, ""), "{arguments:?}: {}", said.err);
    for word in words {
        assert!(said.err.contains(word), "{arguments:?} did not say '{word}':\n{}", said.err);
    }
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn has(value: &Value, names: &[&str]) {
    let found = keys(value);
    assert!(names.iter().all(|n| found.contains(n)), "{found:?} lacks some of {names:?}");
}

fn one_document(said: &Said) -> Value {
    assert_eq!(said.code, 0, "{}", said.err);
    // One document and nothing else: progress is on stderr.
    serde_json::from_str(&said.out).unwrap()
}

#[test]
fn the_answer_of_a_real_recording_has_every_field_that_its_format_promises() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("answer");
    let (model, data) = (measured("pr2_cabinet"), measured("pr2_cabinet/pull_1.csv"));
    let said = sagci(&["gap", &model, "--data", &data, "--out", out.to_str().unwrap(), "--format", "json"]);
    let answer = one_document(&said);
    assert!(said.err.contains("looking for a missing effect"), "progress belongs on stderr: {}", said.err);
    has(
        &answer,
        &[
            "schema",
            "verdict",
            "effects",
            "where",
            "gap",
            "unexplained",
            "rejected",
            "residual",
            "next_experiment",
            "baselines",
            "model",
            "notes",
            "seconds",
        ],
    );
    assert_eq!(answer["schema"], 1);
    assert!(["no_gap", "named", "ambiguous", "unknown"].contains(&answer["verdict"].as_str().unwrap()));
    assert!(!answer["effects"].as_array().unwrap().is_empty(), "the cabinet closes by itself");
    for effect in answer["effects"].as_array().unwrap() {
        has(effect, &["name", "alternatives", "joint", "channel", "parameters", "probability", "confirmed", "evidence", "runners_up"]);
        assert!(["joint", "actuator", "sensor", "kinematic", "body"].contains(&effect["channel"].as_str().unwrap()));
        assert_eq!(effect["confirmed"], false, "nothing was held out");
        has(&effect["evidence"], &["log_bayes_factor", "log_bayes_factor_nameless", "explained", "held_out"]);
        for parameter in effect["parameters"].as_object().unwrap().values() {
            assert_eq!(keys(parameter).len(), 4);
            let [value, lower, upper] = ["value", "lower", "upper"].map(|k| parameter[k].as_f64().unwrap());
            assert!(lower <= value && value <= upper && parameter["unit"].is_string(), "{parameter}");
        }
        for runner in effect["runners_up"].as_array().unwrap() {
            has(runner, &["name", "reason"]);
        }
    }
    for place in answer["where"].as_array().unwrap() {
        has(place, &["joint", "channel", "region", "share", "p_value"]);
        for range in ["position", "velocity", "time"] {
            assert_eq!(place["region"][range].as_array().unwrap().len(), 2);
        }
    }
    assert_eq!(answer["gap"]["held_out"], Value::Null);
    let gap = &answer["gap"]["train"];
    has(gap, &["before", "refitted", "after", "noise_floor", "per_joint"]);
    for joint in gap["per_joint"].as_object().unwrap().values() {
        has(joint, &["before", "refitted", "after", "noise_floor", "median", "short", "range", "unit"]);
    }
    assert!(gap["after"].as_f64().unwrap() < gap["before"].as_f64().unwrap());

    // The same document in the folder; a page that loads nothing; a model that reads.
    assert_eq!(std::fs::read_to_string(out.join("gap.json")).unwrap(), said.out);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains(answer["effects"][0]["name"].as_str().unwrap()) && page.contains("<svg"));
    for outside in ["http://", "https://", "<script", "<link", "@import", "url(http", "NaN", ">inf<"] {
        assert!(!page.contains(outside), "the page has '{outside}'");
    }
    assert_eq!(answer["model"], out.join("model.urdf").to_str().unwrap());
    let table = folder.path().join("prediction.csv");
    let said = sagci(&["simulate", answer["model"].as_str().unwrap(), "--data", &data, "--out", table.to_str().unwrap()]);
    assert_eq!(said.code, 0, "{}", said.err);
    // The gap can be checked by the table that the written model gives.
    let table = std::fs::read_to_string(table).unwrap();
    let errors: Vec<f64> = table
        .lines()
        .skip(1)
        .filter_map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            Some(cells[2].parse::<f64>().ok()? - cells[4].parse::<f64>().ok()?)
        })
        .collect();
    let rmse = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    let said = gap["per_joint"].as_object().unwrap().values().next().unwrap()["after"].as_f64().unwrap();
    assert!((rmse - said).abs() < 0.03 * said, "the table gives {rmse}, the answer says {said}");
}

#[test]
fn bad_input_is_refused_with_its_place_and_what_to_do() {
    let bench = Bench::new();
    let good = bench.path("swing.csv");
    bench.refused(&["--data", &bench.path("none.csv")], &["none.csv"]);
    // Neither a file nor an object.
    refused(&["gap", "nowhere/door.urdf", "--data", &good], &["nowhere/door.urdf", "no such file"]);
    let models = bench.library();
    refused(&["gap", "pendulun", "--data", &good, "--models", &models], &["did you mean 'pendulum'?"]);
    // A name that is nearly right, and one that is not.
    let rows = swing(0.9, 0.05, 3.0);
    let near = bench.write("near.csv", csv("time,pivto.position", &rows));
    bench.refused(&["--data", &near], &["pivto", "did you mean 'pivot'?"]);
    let wrong = bench.write("wrong.csv", csv("time,elbow.position", &rows));
    bench.refused(&["--data", &wrong], &["elbow", "pivot"]);
    // Degrees are asked back about, and taken once it is said what they are.
    let degrees: Vec<[f64; 2]> = swing(0.9, 0.05, 6.0).iter().map(|[t, q]| [*t, q.to_degrees()]).collect();
    let degrees = bench.write("degrees.csv", csv("time,pivot.position", &degrees));
    bench.refused(&["--data", &degrees], &["deg"]);
    // Nothing moves: which experiment to run.
    let still: Vec<[f64; 2]> = (0..400).map(|k| [0.01 * f64::from(k), 0.0]).collect();
    let still = bench.write("still.csv", csv("time,pivot.position", &still));
    bench.refused(&["--data", &still], &["never moves", "Record it"]);
    // Broken cells say where.
    let text = csv("time,pivot.position", &rows).replace("\n0.100,", "\n0.100,abc");
    let cells = bench.write("cells.csv", text);
    bench.refused(&["--data", &cells], &["cells.csv"]);
    let few = bench.write("few.csv", csv("time,pivot.position", &rows[..4]));
    bench.refused(&["--data", &few], &["few"]);
    // An MCAP of which not even the first message is whole; and a command without its drive's law.
    let cut = bench.write("cut.mcap", b"\x89MCAP0\r\n\x01");
    bench.refused(&["--data", &cut], &["cut.mcap"]);
    // Arguments.
    bench.refused(&["--data", &good, "--window", "0"], &["window"]);
    bench.refused(&["--data", &good, "--accept-unconfirmed"], &["--apply"]);
    bench.refused(&[], &["--data"]);
    bench.refused(&["--data", &good, "--out", &good], &["is a file"]);
    // No model that is not from here is written over.
    bench.refused(&["--data", &good, "--out", &bench.path("pendulum")], &["written over"]);
    assert_eq!(std::fs::read_to_string(bench.path("pendulum/model.yaml")).unwrap(), YAML);
}

#[test]
fn one_trajectory_without_effort_is_answered_with_what_it_can_show() {
    let bench = Bench::new();
    let out = bench.path("out");
    let (model, data) = (bench.path("pendulum/object.urdf"), bench.path("swing.csv"));
    let before = std::fs::read(&data).unwrap();
    let said = sagci(&["gap", &model, "--data", &data, "--out", &out, "--format", "json"]);
    let answer = one_document(&said);
    assert_eq!(answer["effects"][0]["name"], "viscous_friction", "{}", said.out);
    assert_eq!(answer["effects"][0]["confirmed"], false);
    let notes = answer["notes"].to_string();
    assert!(notes.contains("too few to set one aside"), "{notes}");
    assert!(notes.contains("effort"), "it is said what cannot be found without effort: {notes}");
    assert_eq!(std::fs::read(&data).unwrap(), before);
    // What URDF can say stands in both files, once for whoever simulates it.
    let value = answer["effects"][0]["parameters"]["damping"]["value"].as_f64().unwrap();
    assert!((value - 0.05).abs() < 0.005, "{value}");
    let urdf = std::fs::read_to_string(Path::new(&out).join("model.urdf")).unwrap();
    let yaml = std::fs::read_to_string(Path::new(&out).join("model.yaml")).unwrap();
    assert!(urdf.contains(&format!("damping=\"{value}\"")), "{urdf}");
    assert!(yaml.contains("viscous_friction") && yaml.contains("in_urdf: true") && yaml.contains("intervals"), "{yaml}");
    // The same seed, the same answer; and the folder of an answer may take the next one.
    let again = one_document(&sagci(&["gap", &model, "--data", &data, "--out", &out, "--format", "json"]));
    let but_time = |mut v: Value| {
        v["seconds"] = Value::Null;
        v
    };
    assert_eq!(but_time(again), but_time(answer));
    // With it nothing is missing any more.
    let model = Path::new(&out).join("model.urdf");
    let said = sagci(&["gap", model.to_str().unwrap(), "--data", &bench.path("other.csv"), "--format", "json"]);
    assert_eq!(one_document(&said)["verdict"], "no_gap", "{}", said.out);
}

#[test]
fn held_out_data_in_which_nothing_moves_deny_nothing() {
    let bench = Bench::new();
    let rows: Vec<[f64; 2]> = (0..500).map(|k| [0.01 * f64::from(k), 0.3]).collect();
    bench.write("still.csv", csv("time,pivot.position", &rows));
    let model = bench.path("pendulum/object.urdf");
    let said = sagci(&["gap", &model, "--data", &bench.path("swing.csv"), "--held-out", &bench.path("still.csv"), "--format", "json"]);
    let answer = one_document(&said);
    assert_eq!(answer["effects"][0]["name"], "viscous_friction", "{}", said.out);
    assert!(answer["gap"]["held_out"].is_null() && answer["notes"].to_string().contains("nothing moves"), "{}", said.out);
}

fn head(models: &str) -> String {
    std::fs::read_to_string(Path::new(models).join("pendulum/HEAD")).unwrap()
}

fn versions(models: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(Path::new(models).join("pendulum")).unwrap();
    entries.map(|e| e.unwrap().path()).filter(|p| p.is_dir()).collect()
}

#[test]
fn only_what_held_out_data_confirm_is_published_and_a_failure_leaves_the_old_version() {
    let bench = Bench::new();
    let (swing, other) = (bench.path("swing.csv"), bench.path("other.csv"));
    // A path is no object of the library: that is said before the work.
    bench.refused(&["--data", &swing, "--apply"], &["sagci models add", "--apply"]);

    let models = bench.library();
    let first = head(&models);
    let gap = |more: &[&str]| {
        let mut all = vec!["gap", "pendulum", "--models", &models, "--format", "json", "--apply", "--data", &swing];
        all.extend(more);
        sagci(&all)
    };
    // Nothing held out: nothing confirmed, nothing published.
    let said = gap(&[]);
    assert!(one_document(&said)["notes"].to_string().contains("--accept-unconfirmed"), "{}", said.out);
    assert_eq!((head(&models), versions(&models).len()), (first.clone(), 1));

    // A model that the library does not take, here for want of its terms: the answer is given, the exit code says that it failed.
    let folder = Path::new(&models).join("pendulum").join(first.trim());
    let bare = YAML.split("provenance").next().unwrap();
    bench.write("bare/object.urdf", PENDULUM);
    bench.write("bare/model.yaml", bare.replace("name: pendulum", "name: bare"));
    let raw = Path::new(&models).join("bare").join("0123456789ab");
    std::fs::create_dir_all(&raw).unwrap();
    for file in ["object.urdf", "model.yaml"] {
        std::fs::copy(bench.folder.path().join("bare").join(file), raw.join(file)).unwrap();
    }
    let named = sagci_library_version(&raw);
    let home = raw.parent().unwrap();
    std::fs::rename(&raw, home.join(&named)).unwrap();
    std::fs::write(home.join("HEAD"), named.clone() + "\n").unwrap();
    let said = sagci(&["gap", "bare", "--models", &models, "--format", "json", "--apply", "--data", &swing, "--held-out", &other]);
    assert_eq!(said.code, 2, "{}", said.err);
    assert!(said.err.contains("not published") && said.err.contains("licence"), "{}", said.err);
    assert!(serde_json::from_str::<Value>(&said.out).is_ok(), "the answer is lost");
    assert_eq!(std::fs::read_to_string(home.join("HEAD")).unwrap().trim(), named);
    std::fs::remove_dir_all(home).unwrap();

    // Confirmed on the other swing: published, with its evidence, and the old version stays.
    let said = gap(&["--held-out", &other]);
    let answer = one_document(&said);
    assert_eq!(answer["effects"][0]["confirmed"], true, "{}", said.out);
    let second = head(&models);
    assert_ne!(second, first);
    assert_eq!(answer["model"].as_str().unwrap(), second.trim());
    assert!(folder.join("model.yaml").is_file());
    let published = Path::new(&models).join("pendulum").join(second.trim());
    let evidence: Value = serde_json::from_slice(&std::fs::read(published.join("evidence/gap.json")).unwrap()).unwrap();
    assert_eq!(evidence["model"], format!("pendulum/{}", first.trim()), "evidence names the version that it was found with");
    assert!(published.join("evidence/report.html").is_file());
    let yaml = std::fs::read_to_string(published.join("model.yaml")).unwrap();
    assert!(yaml.contains("viscous_friction") && yaml.contains("held_out:"), "{yaml}");
    assert_eq!(sagci(&["models", "verify", "--models", &models]).code, 0);
    // With it nothing is missing: no third version.
    let answer = one_document(&gap(&["--held-out", &other]));
    assert_eq!(answer["verdict"], "no_gap");
    assert_eq!((head(&models), versions(&models).len()), (second, 2));
}

/// The name that a folder's bytes have.
fn sagci_library_version(folder: &Path) -> String {
    sagci_library::Version::of_folder(folder).unwrap().to_string()
}

#[test]
fn a_truncated_recording_is_used_as_far_as_it_is_whole_and_that_is_said() {
    let bench = Bench::new();
    let text = csv("time,pivot.position", &swing(0.9, 0.05, 6.0));
    let cut = bench.write("cut.csv", &text[..text.rfind(',').unwrap() - 1]);
    let said = sagci(&["gap", &bench.path("pendulum"), "--data", &cut, "--format", "json"]);
    let answer = one_document(&said);
    assert!(answer["notes"].to_string().contains("left out"), "{}", answer["notes"]);
    // Unsorted, repeated, missing: set right and said.
    let mut lines: Vec<&str> = text.lines().collect();
    lines.swap(100, 101);
    lines.insert(200, lines[200]);
    let nan = lines[300].split(',').next().unwrap().to_owned() + ",nan";
    lines[300] = &nan;
    let mess = bench.write("mess.csv", lines.join("\n") + "\n");
    let answer = one_document(&sagci(&["gap", &bench.path("pendulum"), "--data", &mess, "--format", "json"]));
    assert_eq!(answer["effects"][0]["name"], "viscous_friction");
    let notes = answer["notes"].to_string();
    assert!(notes.contains("put in order") && notes.contains("repeat the time") && notes.contains("NaN"), "{notes}");
}

fn simulated(model: &str, data: &str, out: &str) -> Said {
    sagci(&["simulate", model, "--data", data, "--out", out])
}

#[test]
fn what_is_read_is_never_written_over() {
    let bench = Bench::new();
    let (model, data) = (bench.path("pendulum"), bench.path("swing.csv"));
    let before = std::fs::read(&data).unwrap();
    let same = bench.path("pendulum/../swing.csv");
    let yaml = bench.path("pendulum/model.yaml");
    let mut outs = vec![data.clone(), same, yaml, bench.path("pendulum/object.urdf")];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&data, bench.path("link.csv")).unwrap();
        std::fs::hard_link(&data, bench.path("hard.csv")).unwrap();
        outs.extend([bench.path("link.csv"), bench.path("hard.csv")]);
        // An answer's model.urdf that is the given one under another name.
        std::fs::create_dir(bench.path("linked")).unwrap();
        std::os::unix::fs::symlink(bench.path("pendulum/object.urdf"), bench.path("linked/model.urdf")).unwrap();
        bench.refused(&["--data", &data, "--out", &bench.path("linked")], &["linked/model.urdf", "object.urdf", "written over"]);
    }
    for out in outs {
        refused(&["simulate", &model, "--data", &data, "--out", &out], &[&out, "written over"]);
    }
    // A recording that is named as a file of the answer.
    let inside = bench.write("answer/report.html", &before);
    bench.refused(&["--data", &inside, "--out", &bench.path("answer")], &["answer/report.html", "written over"]);
    let other = bench.path("other.csv");
    bench.refused(&["--data", &other, "--held-out", &inside, "--out", &bench.path("answer")], &["answer/report.html", "written over"]);
    assert_eq!((std::fs::read(&data).unwrap(), std::fs::read(inside).unwrap()), (before.clone(), before));
    assert_eq!(std::fs::read_to_string(bench.path("pendulum/model.yaml")).unwrap(), YAML);
    assert_eq!(std::fs::read_to_string(bench.path("pendulum/object.urdf")).unwrap(), PENDULUM);
    // A version of the library is what its name says.
    let models = bench.library();
    let inside = Path::new(&models).join("pendulum").join(head(&models).trim()).join("new.csv");
    refused(&["simulate", "pendulum", "--models", &models, "--data", &data, "--out", inside.to_str().unwrap()], &["library"]);
}

#[test]
fn a_place_that_cannot_be_written_to_is_known_before_the_search() {
    let bench = Bench::new();
    let data = bench.path("swing.csv");
    let below_a_file = bench.path("swing.csv/answer");
    for said in [
        sagci(&["gap", &bench.path("pendulum"), "--data", &data, "--out", &below_a_file]),
        simulated(&bench.path("pendulum"), &data, &bench.path("none/prediction.csv")),
        simulated(&bench.path("pendulum"), &data, &bench.path("pendulum")),
    ] {
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{}", said.err);
        assert!(said.err.contains("give --out") && !said.err.contains("refitting"), "{}", said.err);
    }
    // Nothing is left of a folder that was made for an answer that there is not.
    bench.refused(&["--data", &data, "--window", "100", "--out", &bench.path("new/deep")], &["--window"]);
    assert!(!Path::new(&bench.path("new")).exists());
}

#[test]
fn a_folder_with_anothers_model_or_page_is_no_place_for_an_answer() {
    let bench = Bench::new();
    let data = bench.path("swing.csv");
    for name in ["model.urdf", "report.html", "gap.json", "robot.urdf"] {
        let path = bench.write(&format!("{name}.d/{name}"), "somebody's");
        bench.refused(&["--data", &data, "--out", &bench.path(&format!("{name}.d"))], &[name, "did not write", "new folder"]);
        assert_eq!(std::fs::read_to_string(path).unwrap(), "somebody's");
    }
}

#[test]
fn held_out_data_that_are_fitted_to_confirm_nothing_and_are_refused() {
    let bench = Bench::new();
    let (swing, other) = (bench.path("swing.csv"), bench.path("other.csv"));
    bench.refused(&["--data", &swing, &other, "--held-out", &other], &["other.csv", "one place"]);
    let copy = bench.write("copy.csv", std::fs::read(&other).unwrap());
    bench.refused(&["--data", &swing, &other, "--held-out", &copy], &["copy.csv", "other.csv", "one place"]);
}

#[test]
fn no_gap_is_given_over_no_window() {
    let bench = Bench::new();
    let swing_csv = bench.path("swing.csv");
    let rows = swing(0.9, 0.05, 0.5);
    let short = bench.write("short.csv", csv("time,pivot.position", &rows));
    let model = bench.path("pendulum");
    bench.refused(&["--data", &swing_csv, "--window", "100"], &["swing.csv", "lasts 6.0", "--window"]);
    bench.refused(&["--data", &short], &["short.csv", "lasts 0.500 s", "--window 0.45"]);
    bench.refused(&["--data", &swing_csv, "--held-out", &short], &["short.csv", "--window 0.45"]);
    refused(&["simulate", &model, "--data", &short, "--out", &bench.path("p.csv")], &["short.csv", "--window 0.45"]);
    // The window that is named fits.
    let said = sagci(&["simulate", &model, "--data", &short, "--out", &bench.path("p.csv"), "--window", "0.45"]);
    assert_eq!(said.code, 0, "{}", said.err);
    // One of several that is too short is no error, and no secret.
    let shorter = bench.write("shorter.csv", csv("time,pivot.position", &rows[..40]));
    let said = sagci(&["simulate", &model, "--data", &swing_csv, &shorter, "--out", &bench.path("p.csv")]);
    assert!(said.code == 0 && said.err.contains("shorter.csv: its longest stretch"), "{}", said.err);
}

#[test]
fn a_prediction_is_at_the_times_of_its_recording_and_says_what_was_not_used() {
    let bench = Bench::new();
    let rows: Vec<String> = swing(0.9, 0.05, 3.0).iter().map(|[t, q]| format!("{:.2},{q:.8},0.1,0,{t}", 1.7e9 + t)).collect();
    let header = "time,pivot.position,pivot.velocity,pivot.effort,pivot.command_voltage\n";
    let data = bench.write("late.csv", header.to_owned() + &rows.join("\n") + "\n");
    let out = bench.path("p.csv");
    let said = simulated(&bench.path("pendulum"), &data, &out);
    assert_eq!(said.code, 0, "{}", said.err);
    let table = std::fs::read_to_string(&out).unwrap();
    let times: Vec<&str> = table.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect();
    let recorded: Vec<&str> = rows.iter().map(|l| l.split(',').next().unwrap().trim_end_matches('0').trim_end_matches('.')).collect();
    assert!(times.len() > 100 && times.iter().all(|t| recorded.contains(t)), "{times:?}");
    for words in ["pivot.command_voltage: is not used", "`kind: dc_motor`", "effects of its drive cannot be seen", "pivot.velocity"] {
        assert!(said.err.contains(words), "'{words}' is not said:\n{}", said.err);
    }
}

#[test]
fn a_name_of_the_library_means_its_object_whatever_folder_is_here() {
    let bench = Bench::new();
    let models = bench.library();
    // A folder of that name, in which nothing can be simulated.
    bench.write("here/pendulum/object.urdf", PENDULUM.replace("pivot", "elbow"));
    let ask = |model: &str| {
        let arguments = ["simulate", model, "--models", &models, "--data", &bench.path("swing.csv"), "--out", &bench.path("p.csv")];
        Command::new(env!("CARGO_BIN_EXE_sagci")).args(arguments).current_dir(bench.path("here")).output().unwrap()
    };
    let said = ask("pendulum");
    let err = String::from_utf8(said.stderr).unwrap();
    assert!(said.status.success() && err.contains("the library's object is taken") && err.contains("./pendulum"), "{err}");
    let err = String::from_utf8(ask("./pendulum").stderr).unwrap();
    assert!(err.contains("elbow"), "{err}");
    // What is nearly there is asked about.
    let err = String::from_utf8(ask("./pendulun").stderr).unwrap();
    assert!(err.contains("./pendulun") && err.contains("did you mean './pendulum'?"), "{err}");
}

#[test]
fn the_command_of_the_next_experiment_is_that_of_the_run() {
    let bench = Bench::new();
    let data = bench.write("my swing.csv", csv("time,pivot.position", &swing(0.9, 0.05, 6.0)));
    let model = bench.path("pendulum");
    let said = sagci(&["gap", &model, "--data", &data, "--window", "0.5", "--seed", "3", "--angles", "rad", "--format", "json"]);
    let answer = one_document(&said);
    let command = answer["next_experiment"]["command"].as_str().unwrap();
    assert!(command.starts_with(&format!("sagci gap {model} --data '{data}' ")), "{command}");
    assert!(command.ends_with(" --angles rad --window 0.5 --seed 3"), "{command}");
}

#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_stdout_does_not_take_is_an_error() {
    let bench = Bench::new();
    let models = bench.library();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let said = Command::new(env!("CARGO_BIN_EXE_sagci")).args(["models", "list", "--models", &models]).stdout(full).output().unwrap();
    assert_eq!(said.status.code(), Some(2));
    assert!(String::from_utf8(said.stderr).unwrap().contains("stdout"));
}

#[test]
fn what_is_wrong_in_a_model_has_its_line() {
    let bench = Bench::new();
    bench.write(
        "pendulum/model.yaml",
        format!("{YAML}effects:\n  - {{effect: coulom_friction, joint: pivot, parameters: {{friction: 0.1}}}}\n"),
    );
    let line = YAML.lines().count() + 2;
    bench.refused(&["--data", &bench.path("swing.csv")], &[&format!("model.yaml:{line}:"), "did you mean 'coulomb_friction'?"]);
}
