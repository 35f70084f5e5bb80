//! Does `model.yaml` fit its URDF? Every name must exist, every direction have length one, every size be possible.

use std::path::Path;

use crate::document::line_of;
use crate::text::did_you_mean;
use crate::{
    Actuator, ActuatorLaw, Camera, Configuration, Document, GraspHint, Gripper, JointKind, ModelError, ObjectModel, Region, Robot, XyzRpy,
};

/// Where an entry stands, and what the model has to check it against.
struct Check<'a> {
    model: &'a ObjectModel,
    path: &'a Path,
    text: &'a str,
    /// For messages: `grasp 'handle'`.
    place: String,
    /// The word that is looked for to find the line.
    word: String,
}

type Checked = Result<(), ModelError>;

/// Checks the model's document against its links and joints; `text` is the document's, to say on which line it is wrong.
pub(crate) fn check(model: &ObjectModel, path: &Path, text: &str) -> Checked {
    let at = |place: String, word: &str| Check { model, path, text, place, word: word.to_owned() };
    let Document { effects, actuators, grasps, regions, robot, refit_tolerance, surface_friction, .. } = &model.document;
    at("surface_friction".into(), "surface_friction").positive("surface_friction", *surface_friction)?;
    let tolerance = at("refit_tolerance".into(), "refit_tolerance");
    tolerance.not_negative("mass", refit_tolerance.mass)?;
    tolerance.not_negative("center_of_mass", refit_tolerance.center_of_mass)?;
    if model.document.movable && model.links.iter().map(|l| l.inertial.mass).sum::<f64>() <= 0.0 {
        return at("movable".into(), "movable").fail("is true, but no link has a mass; give it an <inertial> in the URDF");
    }
    for e in effects {
        let c = at(format!("effect '{}'", e.effect), &e.effect);
        c.named(&e.effect)?;
        if let Some(joint) = &e.joint {
            c.joint("joint", joint)?;
        }
        for (name, value) in &e.parameters {
            c.finite(name, &[*value])?;
        }
    }
    unique(actuators.iter().map(|a| a.joint.as_str()), |n| at(format!("actuator of '{n}'"), n))?;
    for a in actuators {
        at(format!("actuator of '{}'", a.joint), &a.joint).actuator(a)?;
    }
    unique(grasps.iter().map(GraspHint::name), |n| at(format!("grasp '{n}'"), n))?;
    for g in grasps {
        let c = at(format!("grasp '{}'", g.name()), g.name());
        c.named(g.name())?;
        c.link("link", g.link())?;
        c.grasp(g)?;
    }
    unique(regions.iter().map(|r| r.name.as_str()), |n| at(format!("region '{n}'"), n))?;
    for r in regions {
        at(format!("region '{}'", r.name), &r.name).region(r)?;
    }
    match robot {
        Some(r) => at("robot".into(), "robot").robot(r),
        None => Ok(()),
    }
}

/// Fails at the first name that stands a second time.
fn unique<'a>(names: impl Iterator<Item = &'a str>, at: impl Fn(&str) -> Check<'a>) -> Checked {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            return at(name).fail("stands there twice; names must be unique");
        }
    }
    Ok(())
}

impl Check<'_> {
    fn fail(&self, message: impl Into<String>) -> Checked {
        let line = line_of(self.text, &self.word);
        Err(ModelError::Impossible { path: self.path.to_owned(), line, place: self.place.clone(), message: message.into() })
    }

    /// The same entry, with its line looked for by another word.
    fn at(&self, place: impl Into<String>, word: &str) -> Self {
        Self { place: place.into(), word: word.to_owned(), ..*self }
    }

    fn named(&self, name: &str) -> Checked {
        if name.trim().is_empty() { self.fail("has no name") } else { Ok(()) }
    }

    fn finite(&self, what: &str, values: &[f64]) -> Checked {
        match values.iter().find(|v| !v.is_finite()) {
            Some(v) => self.fail(format!("has {v} in its {what}; it must be a finite number")),
            None => Ok(()),
        }
    }

    fn positive(&self, what: &str, value: f64) -> Checked {
        self.finite(what, &[value])?;
        if value <= 0.0 { self.fail(format!("has a {what} of {value}; it must be positive")) } else { Ok(()) }
    }

    fn not_negative(&self, what: &str, value: f64) -> Checked {
        self.finite(what, &[value])?;
        if value < 0.0 { self.fail(format!("has a {what} of {value}; it must not be negative")) } else { Ok(()) }
    }

    fn within(&self, what: &str, value: f64, most: f64) -> Checked {
        self.not_negative(what, value)?;
        if value > most { self.fail(format!("has a {what} of {value}; it may be at most {most:.4}")) } else { Ok(()) }
    }

    fn unit(&self, what: &str, v: [f64; 3]) -> Checked {
        self.finite(what, &v)?;
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > 1e-3 {
            return self.fail(format!("has {what} {v:?} of length {length:.4}; it must be a unit vector"));
        }
        Ok(())
    }

    fn pose(&self, what: &str, X: &XyzRpy) -> Checked {
        self.finite(what, &X.xyz)?;
        self.finite(what, &X.rpy)
    }

    fn link(&self, what: &str, name: &str) -> Checked {
        if self.model.link(name).is_some() {
            return Ok(());
        }
        let hint = did_you_mean(name, self.model.links.iter().map(|l| l.name.as_str()));
        self.at(self.place.clone(), name).fail(format!("has the {what} '{name}', which the URDF does not have{hint}"))
    }

    /// The joint must exist and move.
    fn joint(&self, what: &str, name: &str) -> Result<(), ModelError> {
        let here = self.at(self.place.clone(), name);
        match self.model.joint(name).map(|i| &self.model.joints[i]) {
            Some(j) if j.kind == JointKind::Fixed => here.fail(format!("has the {what} '{name}', which is fixed")),
            Some(_) => Ok(()),
            None => {
                let moving = self.model.joints.iter().filter(|j| j.kind != JointKind::Fixed).map(|j| j.name.as_str());
                here.fail(format!("has the {what} '{name}', which the URDF does not have{}", did_you_mean(name, moving)))
            }
        }
    }

    fn actuator(&self, a: &Actuator) -> Checked {
        self.joint("joint", &a.joint)?;
        let above_zero = |name: &str, x: f64| if x > 0.0 { Ok(()) } else { self.fail(format!("has a {name} of {x}; it must be positive")) };
        let known: &[&str] = match &a.law {
            ActuatorLaw::Torque { max_effort } => {
                above_zero("max_effort", *max_effort)?;
                &["max_effort"]
            }
            ActuatorLaw::PositionServo { stiffness, damping, max_effort } => {
                self.positive("stiffness", *stiffness)?;
                self.not_negative("damping", *damping)?;
                above_zero("max_effort", *max_effort)?;
                &["stiffness", "damping", "max_effort"]
            }
            ActuatorLaw::DcMotor { torque_constant, resistance, gain, max_voltage } => {
                self.positive("torque_constant", *torque_constant)?;
                self.positive("resistance", *resistance)?;
                gain.map_or(Ok(()), |g| self.positive("gain", g))?;
                above_zero("max_voltage", *max_voltage)?;
                &["torque_constant", "resistance", "gain", "max_voltage"]
            }
        };
        for (name, fraction) in &a.refit {
            if !known.contains(&name.as_str()) {
                let hint = did_you_mean(name, known.iter().copied());
                return self.fail(format!("has '{name}' under refit, which its law does not have{hint}"));
            }
            self.positive(name, *fraction)?;
        }
        Ok(())
    }

    fn grasp(&self, g: &GraspHint) -> Checked {
        match g {
            GraspHint::Bar(b) => {
                self.finite("from", &b.from)?;
                self.finite("to", &b.to)?;
                self.positive("radius", b.radius)?;
                self.unit("outward", b.outward)?;
                self.within("swing", b.swing, std::f64::consts::PI)?;
                self.not_negative("depth", b.depth)?;
                let along = [0, 1, 2].map(|k| b.to[k] - b.from[k]);
                let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length < 1e-6 {
                    return self.fail("begins where it ends; 'from' and 'to' are the two ends of the bar");
                }
                let lean = (0..3).map(|k| along[k] / length * b.outward[k]).sum::<f64>();
                if lean.abs() > 0.1 {
                    return self.fail("has an 'outward' that is not across the bar; the hand comes from the side");
                }
                Ok(())
            }
            GraspHint::Rim(r) => {
                self.finite("center", &r.center)?;
                self.unit("axis", r.axis)?;
                self.positive("radius", r.radius)?;
                self.positive("thickness", r.thickness)?;
                self.positive("depth", r.depth)?;
                self.within("tilt", r.tilt, std::f64::consts::FRAC_PI_2)?;
                if r.thickness >= 2.0 * r.radius {
                    return self.fail(format!("has a wall of {} m, thicker than its ring is wide", r.thickness));
                }
                for [angle, half_width] in &r.blocked {
                    self.finite("blocked", &[*angle])?;
                    self.within("blocked half width", *half_width, std::f64::consts::PI)?;
                }
                Ok(())
            }
        }
    }

    fn region(&self, r: &Region) -> Checked {
        self.named(&r.name)?;
        self.link("link", &r.link)?;
        self.finite("center", &r.center)?;
        for size in r.size {
            self.positive("size", size)?;
        }
        self.unit("opening", r.opening)
    }

    fn robot(&self, r: &Robot) -> Checked {
        if r.arm_joints.is_empty() {
            return self.fail("has no arm_joints");
        }
        unique(r.arm_joints.iter().map(String::as_str), |n| self.at("robot: arm_joints", n))?;
        for name in &r.arm_joints {
            self.at("robot: arm_joints", name).one_position(name)?;
        }
        self.at("robot", "wrist_link").link("wrist_link", &r.wrist_link)?;
        self.at("robot: gripper", "gripper").gripper(&r.gripper)?;
        self.at("robot: camera", "camera").camera(&r.camera)?;
        unique(r.configurations.iter().map(|c| c.name.as_str()), |n| self.at(format!("configuration '{n}'"), n))?;
        for c in &r.configurations {
            self.at(format!("configuration '{}'", c.name), &c.name).configuration(c, &r.arm_joints)?;
        }
        if !r.configurations.iter().any(|c| c.name == "ready") {
            return self.at("robot: configurations", "configurations").fail("has none with the name 'ready', where a run starts");
        }
        Ok(())
    }

    /// The joint must exist, and have one position.
    fn one_position(&self, name: &str) -> Checked {
        self.joint("joint", name)?;
        match self.model.joint(name).map(|i| &self.model.joints[i]) {
            Some(j) if j.kind.positions() == 1 && j.mimic.is_none() => Ok(()),
            _ => self.fail(format!("has the joint '{name}', which does not move on its own in one direction")),
        }
    }

    fn gripper(&self, g: &Gripper) -> Checked {
        self.link("link", &g.link)?;
        self.pose("X_LT", &g.X_LT)?;
        self.positive("max_width", g.max_width)?;
        self.positive("max_force", g.max_force)?;
        for extent in g.pad_half_extents {
            self.positive("pad_half_extents", extent)?;
        }
        let mut opening = 0.0;
        for f in &g.fingers {
            self.joint("joint", &f.joint)?;
            self.link("link", &f.link)?;
            let Some(joint) = self.model.joint(&f.joint).map(|i| &self.model.joints[i]) else { continue };
            if joint.kind != JointKind::Prismatic {
                return self.fail(format!("has the finger joint '{}', which does not slide", f.joint));
            }
            if self.model.links[joint.child].name != f.link {
                let moved = &self.model.links[joint.child].name;
                return self.fail(format!("has the finger link '{}', but joint '{}' moves the link '{moved}'", f.link, f.joint));
            }
            opening += joint.limits.upper;
        }
        if g.fingers[0].joint == g.fingers[1].joint {
            return self.fail("has one joint for both fingers");
        }
        if g.max_width > opening + 1e-9 {
            return self.fail(format!("has a max_width of {} m, but its fingers open by {opening} m", g.max_width));
        }
        Ok(())
    }

    fn camera(&self, c: &Camera) -> Checked {
        self.link("link", &c.link)?;
        self.pose("X_LC", &c.X_LC)?;
        for k in 0..2 {
            if !(1..=8192).contains(&c.size[k]) {
                return self.fail(format!("has a size of {} pixels; 1 to 8192 can be", c.size[k]));
            }
            self.positive("focal", c.focal[k])?;
            self.within("center", c.center[k], c.size[k] as f64)?;
        }
        self.positive("range", c.range[0])?;
        self.finite("range", &c.range)?;
        if c.range[1] <= c.range[0] {
            return self.fail(format!("has a range from {} to {} m; the second must be the greater", c.range[0], c.range[1]));
        }
        Ok(())
    }

    fn configuration(&self, c: &Configuration, arm_joints: &[String]) -> Checked {
        self.named(&c.name)?;
        self.finite("q", &c.q)?;
        if c.q.len() != arm_joints.len() {
            return self.fail(format!("has {} positions for {} arm_joints", c.q.len(), arm_joints.len()));
        }
        for (q, name) in c.q.iter().zip(arm_joints) {
            let Some(limits) = self.model.joint(name).map(|i| self.model.joints[i].limits) else { continue };
            if *q < limits.lower || *q > limits.upper {
                return self.fail(format!("puts '{name}' at {q}, outside its limits of {} to {}", limits.lower, limits.upper));
            }
        }
        Ok(())
    }
}
