//! No input makes the reader panic, hang or take memory without bound: seeded mutations of good files.
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;

/// Pieces that parsers are sensitive to.
const PIECES: &[&str] = &[
    "<",
    ">",
    "/>",
    "</",
    "\"",
    "'",
    "&",
    "&amp;",
    "&#0;",
    "<!--",
    "-->",
    "<![CDATA[",
    "<?",
    "\0",
    "é",
    "\u{feff}",
    "nan",
    "inf",
    "1e999",
    "-0",
    "1e-999",
    "<link name=\"x\"/>",
    "<mimic joint=\"j\"/>",
    " xyz=\"0 0 0\"",
    "- ",
    ": ",
    "{",
    "[",
    "*a",
    "&a ",
    "!!binary ",
    "~",
    "\n",
    "\t",
    "|",
    ">-",
    "4294967295",
    "99999999999999999999",
];

fn mutate(bytes: &[u8], rng: &mut Pcg64) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..rng.random_range(1..=6) {
        let at = rng.random_range(0..=out.len());
        let end = (at + rng.random_range(0..40)).min(out.len());
        match rng.random_range(0..6) {
            0 if at < out.len() => out[at] = rng.random(),
            1 => drop(out.drain(at..end)),
            2 => {
                let piece = PIECES[rng.random_range(0..PIECES.len())];
                out.splice(at..at, piece.bytes());
            }
            3 => {
                let copy = out[at..end].to_vec();
                let to = rng.random_range(0..=out.len());
                out.splice(to..to, copy);
            }
            4 => out.truncate(at),
            _ if at < out.len() => out[at] ^= 1 << rng.random_range(0..8),
            _ => {}
        }
    }
    out
}

/// Reads `rounds` mutations of one file of a good model; the others stay as they are.
fn check(file: &str, good: &[u8], others: &[(&str, &[u8])], rounds: u64) {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in others {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let path = folder.path().join(file);
    std::fs::write(&path, good).unwrap();
    ObjectModel::read(folder.path()).unwrap_or_else(|e| panic!("the good model is not good: {e}"));
    let mut refused = 0;
    for seed in 0..rounds {
        let bytes = mutate(good, &mut Pcg64::seed_from_u64(seed));
        std::fs::write(&path, &bytes).unwrap();
        let read = std::panic::catch_unwind(|| ObjectModel::read(folder.path()));
        match read {
            Ok(Ok(model)) => drop(model.to_urdf()),
            Ok(Err(error)) => {
                assert!(error.to_string().len() < 3000, "{file}, seed {seed}: the message is as long as a file");
                refused += 1;
            }
            Err(_) => panic!("{file}, seed {seed}: panicked"),
        }
    }
    assert!(refused > rounds / 4, "{file}: only {refused} of {rounds} mutations were refused; do they change anything?");
}

fn shipped(file: &str) -> Vec<u8> {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../world-models/drawer");
    let head = std::fs::read_to_string(home.join("HEAD")).unwrap();
    std::fs::read(home.join(head.trim()).join(file)).unwrap()
}

/// The drawer's URDF with its meshes taken out, so that each round reads one file.
fn urdf() -> String {
    let text = String::from_utf8(shipped("object.urdf")).unwrap();
    text.lines().filter(|l| !l.contains("<mesh")).collect::<Vec<_>>().join("\n")
}

const BRICK: &str = "<robot name=\"r\"><link name=\"l\"><visual><geometry><mesh filename=\"m.FILE\"/></geometry></visual></link></robot>";

#[test]
fn no_urdf_makes_the_reader_panic() {
    check("object.urdf", urdf().as_bytes(), &[], 1500);
}

#[test]
fn no_document_makes_the_reader_panic() {
    check("model.yaml", &shipped("model.yaml"), &[("object.urdf", urdf().as_bytes())], 1500);
}

#[test]
fn no_binary_stl_makes_the_reader_panic() {
    let urdf = BRICK.replace("FILE", "stl");
    check("m.stl", &shipped("meshes/drawer.stl"), &[("object.urdf", urdf.as_bytes())], 800);
}

#[test]
fn no_ascii_stl_makes_the_reader_panic() {
    let urdf = BRICK.replace("FILE", "stl");
    let stl = b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1.5e0 0\nendloop\nendfacet\nendsolid s\n";
    check("m.stl", stl, &[("object.urdf", urdf.as_bytes())], 1500);
}

#[test]
fn no_obj_makes_the_reader_panic() {
    let urdf = BRICK.replace("FILE", "obj");
    let obj = b"# a face\nv 0 0 0\nv 1 0 0\nv 0 1 0 0.5 0.5 0.5\nvn 0 0 1\nf 1//1 2/1/1 -1\nf 1 2 3\n";
    check("m.obj", obj, &[("object.urdf", urdf.as_bytes())], 1500);
}
