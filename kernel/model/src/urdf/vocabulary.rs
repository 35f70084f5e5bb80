//! What URDF's elements may hold, and a check of a scanned document against it. urdf-rs passes over what it does not
//! know and over numbers that it cannot read; here a misspelt name or a broken number is an error with its line.

use crate::text::{did_you_mean, nearest};
use crate::xml::{Element, XmlError};

/// One element of URDF 1.1 (<https://wiki.ros.org/urdf/XML>).
struct Entry {
    name: &'static str,
    /// Attributes, and how many numbers each holds (0: text).
    attributes: &'static [(&'static str, usize)],
    /// Attributes that must be there.
    required: &'static [&'static str],
    children: &'static [&'static str],
    /// Children that must be there.
    needed: &'static [&'static str],
}

const MANY: &[&str] = &["link", "joint", "material", "visual", "collision"];
const SHAPES: &[&str] = &["box", "sphere", "cylinder", "capsule", "mesh"];

#[rustfmt::skip]
const VOCABULARY: &[Entry] = &[
    Entry { name: "robot", attributes: &[("name", 0), ("version", 0)], required: &[], children: &["link", "joint", "material"], needed: &["link"] },
    Entry { name: "link", attributes: &[("name", 0), ("type", 0)], required: &["name"], children: &["inertial", "visual", "collision"], needed: &[] },
    Entry { name: "inertial", attributes: &[], required: &[], children: &["origin", "mass", "inertia"], needed: &["mass", "inertia"] },
    Entry { name: "origin", attributes: &[("xyz", 3), ("rpy", 3), ("quat_xyzw", 4)], required: &[], children: &[], needed: &[] },
    Entry { name: "mass", attributes: &[("value", 1)], required: &["value"], children: &[], needed: &[] },
    Entry { name: "inertia", attributes: &[("ixx", 1), ("ixy", 1), ("ixz", 1), ("iyy", 1), ("iyz", 1), ("izz", 1)],
            required: &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"], children: &[], needed: &[] },
    Entry { name: "visual", attributes: &[("name", 0)], required: &[], children: &["origin", "geometry", "material"], needed: &["geometry"] },
    Entry { name: "collision", attributes: &[("name", 0)], required: &[], children: &["origin", "geometry"], needed: &["geometry"] },
    Entry { name: "geometry", attributes: &[], required: &[], children: SHAPES, needed: &[] },
    Entry { name: "box", attributes: &[("size", 3)], required: &["size"], children: &[], needed: &[] },
    Entry { name: "sphere", attributes: &[("radius", 1)], required: &["radius"], children: &[], needed: &[] },
    Entry { name: "cylinder", attributes: &[("radius", 1), ("length", 1)], required: &["radius", "length"], children: &[], needed: &[] },
    Entry { name: "capsule", attributes: &[("radius", 1), ("length", 1)], required: &["radius", "length"], children: &[], needed: &[] },
    Entry { name: "mesh", attributes: &[("filename", 0), ("scale", 3)], required: &["filename"], children: &[], needed: &[] },
    Entry { name: "material", attributes: &[("name", 0)], required: &[], children: &["color", "texture"], needed: &[] },
    Entry { name: "color", attributes: &[("rgba", 4)], required: &["rgba"], children: &[], needed: &[] },
    Entry { name: "texture", attributes: &[("filename", 0)], required: &[], children: &[], needed: &[] },
    Entry { name: "joint", attributes: &[("name", 0), ("type", 0)], required: &["name", "type"],
            children: &["origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic", "safety_controller"], needed: &["parent", "child"] },
    Entry { name: "parent", attributes: &[("link", 0)], required: &["link"], children: &[], needed: &[] },
    Entry { name: "child", attributes: &[("link", 0)], required: &["link"], children: &[], needed: &[] },
    Entry { name: "axis", attributes: &[("xyz", 3)], required: &["xyz"], children: &[], needed: &[] },
    Entry { name: "calibration", attributes: &[("rising", 1), ("falling", 1)], required: &[], children: &[], needed: &[] },
    Entry { name: "dynamics", attributes: &[("damping", 1), ("friction", 1)], required: &[], children: &[], needed: &[] },
    Entry { name: "limit", attributes: &[("lower", 1), ("upper", 1), ("velocity", 1), ("effort", 1), ("acceleration", 1), ("deceleration", 1), ("jerk", 1)],
            required: &[], children: &[], needed: &[] },
    Entry { name: "mimic", attributes: &[("joint", 0), ("multiplier", 1), ("offset", 1)], required: &["joint"], children: &[], needed: &[] },
    Entry { name: "safety_controller", attributes: &[("soft_lower_limit", 1), ("soft_upper_limit", 1), ("k_position", 1), ("k_velocity", 1)],
            required: &["k_velocity"], children: &[], needed: &[] },
];

const JOINT_TYPES: [&str; 6] = ["fixed", "revolute", "continuous", "prismatic", "floating", "planar"];

/// Checks a scanned document against URDF's vocabulary. Elements that URDF does not have (`gazebo`, `transmission`, ...)
/// are extensions of other programs and are passed over, unless they look like a misspelt one.
pub(crate) fn check(elements: &[Element]) -> Result<(), XmlError> {
    let fail = |e: &Element, message: String| Err(XmlError { line: e.line, message });
    let root = &elements[0];
    if root.name != "robot" {
        return fail(root, format!("the document's element is <{}>, but a URDF's is <robot>{}", root.name, kind_of_file(&root.name)));
    }
    let mut entry_of: Vec<Option<&Entry>> = Vec::with_capacity(elements.len());
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); elements.len()];
    for (i, e) in elements.iter().enumerate() {
        if e.name.starts_with("xacro:") {
            return fail(e, format!("<{}> is xacro, not URDF; expand the file first: xacro FILE.xacro > object.urdf", e.name));
        }
        let expected: &[&str] = match e.parent {
            None => &["robot"],
            Some(p) => match entry_of[p] {
                Some(parent) => {
                    children[p].push(i);
                    parent.children
                }
                None => &[],
            },
        };
        let known = expected.contains(&e.name.as_str());
        if !known && let Some(best) = nearest(&e.name, expected.iter().copied()) {
            return fail(e, format!("<{}> is not an element of URDF; did you mean '{best}'?", e.name));
        }
        entry_of.push(if known { VOCABULARY.iter().find(|v| v.name == e.name) } else { None });
    }
    let old_limits = !matches!(root.attribute("version"), Some(v) if v.trim() >= "1.2");
    for (i, e) in elements.iter().enumerate() {
        let Some(entry) = entry_of[i] else { continue };
        check_attributes(e, entry)?;
        let names: Vec<&str> = children[i].iter().map(|&c| elements[c].name.as_str()).collect();
        for &needed in entry.needed {
            if !names.contains(&needed) {
                return fail(e, format!("{} has no <{needed}>", title(e)));
            }
        }
        for &once in entry.children {
            let twice = children[i].iter().filter(|&&c| elements[c].name == once).nth(1);
            if let Some(&second) = twice.filter(|_| !MANY.contains(&once) || (once == "material" && e.name == "visual")) {
                return fail(&elements[second], format!("{} has a second <{once}>; there can be only one", title(e)));
            }
        }
        match e.name.as_str() {
            "geometry" if names.iter().filter(|n| SHAPES.contains(n)).count() != 1 => {
                return fail(e, format!("<geometry> holds {} shapes instead of one of: {}", names.len(), SHAPES.join(", ")));
            }
            "joint" => {
                let kind = e.attribute("type").unwrap_or("");
                if !JOINT_TYPES.contains(&kind) {
                    let hint = did_you_mean(kind, JOINT_TYPES);
                    return fail(e, format!("{} has the type '{kind}', which URDF does not have{hint}", title(e)));
                }
                if matches!(kind, "revolute" | "prismatic") && old_limits {
                    let Some(&limit) = children[i].iter().find(|&&c| elements[c].name == "limit") else {
                        let hint = if kind == "revolute" { "; a joint without limits is 'continuous'" } else { "" };
                        return fail(e, format!("{} is {kind} and has no <limit>{hint}", title(e)));
                    };
                    for required in ["velocity", "effort"] {
                        if elements[limit].attribute(required).is_none() {
                            return fail(&elements[limit], format!("the <limit> of {} has no {required}", title(e)));
                        }
                    }
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn check_attributes(e: &Element, entry: &Entry) -> Result<(), XmlError> {
    let fail = |message: String| Err(XmlError { line: e.line, message });
    for (name, value) in &e.attributes {
        let Some((_, count)) = entry.attributes.iter().find(|(n, _)| n == name) else {
            // Foreign attributes are passed over, like foreign elements.
            if let Some(best) = nearest(name, entry.attributes.iter().map(|(n, _)| *n)) {
                return fail(format!("<{}> has no attribute '{name}'; did you mean '{best}'?", e.name));
            }
            continue;
        };
        if *count == 0 {
            if value.trim().is_empty() && name != "version" && !(e.name == "material" || name == "filename" && e.name == "texture") {
                return fail(format!("the {name} of <{}> is empty", e.name));
            }
            continue;
        }
        let words: Vec<&str> = value.split_whitespace().collect();
        if words.len() != *count {
            return fail(format!("{name}=\"{value}\" of <{}> holds {} numbers instead of {count}", e.name, words.len()));
        }
        for word in words {
            match word.parse::<f64>() {
                Ok(x) if x.is_finite() => {}
                Ok(_) => return fail(format!("{name}=\"{value}\" of <{}> holds '{word}', which is not a finite number", e.name)),
                Err(_) if word.contains("${") => {
                    return fail(format!(
                        "{name}=\"{value}\" of <{}> is xacro; expand the file first: xacro FILE.xacro > object.urdf",
                        e.name
                    ));
                }
                Err(_) => return fail(format!("{name}=\"{value}\" of <{}> holds '{word}', which is not a number", e.name)),
            }
        }
    }
    for required in entry.required {
        if e.attribute(required).is_none() {
            return fail(format!("{} has no {required}", title(e)));
        }
    }
    Ok(())
}

/// An element as a message names it.
fn title(e: &Element) -> String {
    match e.attribute("name") {
        Some(name) => format!("{} '{name}'", e.name),
        None => format!("<{}>", e.name),
    }
}

fn kind_of_file(root: &str) -> &'static str {
    match root {
        "mujoco" | "mujocoinclude" => "; this looks like a MuJoCo file (MJCF)",
        "sdf" => "; this looks like a Gazebo file (SDF)",
        "COLLADA" => "; this looks like a COLLADA mesh",
        _ => "",
    }
}
