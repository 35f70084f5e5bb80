//! What a person wants to see of stored models: `list`, `show` and `verify`. Plain data, ready to be printed or written
//! as JSON.

use sagci_model::{EffectEntry, GraspHint, JointKind, Provenance};
use serde::Serialize;

use crate::store::Stored;
use crate::version::files;
use crate::{Library, LibraryError, Version, check};

/// One line of `models list`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModelListing {
    /// The object's name.
    pub name: String,
    /// Its current version, if HEAD names one.
    pub version: Option<Version>,
    /// How many versions there are.
    pub versions: usize,
    /// One sentence.
    pub description: String,
    /// What kind of thing it is.
    pub category: String,
    /// `robot`, `movable` or `fixed`.
    pub role: &'static str,
    /// Names of the joints that move.
    pub joints: Vec<String>,
    /// Mass of all links, kg.
    pub mass: f64,
    /// Licence identifier.
    pub licence: String,
    /// Why it cannot be read, if it cannot; the rest is then empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

/// `models show`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModelReport {
    /// What `models list` says.
    #[serde(flatten)]
    pub listing: ModelListing,
    /// The current version's folder.
    pub folder: String,
    /// Size of its files, bytes.
    pub bytes: u64,
    /// All versions.
    pub all_versions: Vec<VersionReport>,
    /// Its links, root first.
    pub links: Vec<LinkReport>,
    /// Its joints, in the tree's order.
    pub joint_list: Vec<JointReport>,
    /// How it can be held.
    pub grasps: Vec<GraspReport>,
    /// Where other things can be put.
    pub regions: Vec<RegionReport>,
    /// Its named effects.
    pub effects: Vec<EffectEntry>,
    /// Names of a robot's configurations.
    pub configurations: Vec<String>,
    /// Where it comes from.
    pub provenance: Provenance,
}

/// One version.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VersionReport {
    /// Its name.
    pub version: Version,
    /// Is it the current one?
    pub head: bool,
    /// Names of its evidence files.
    pub evidence: Vec<String>,
}

/// One link.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LinkReport {
    /// Its name.
    pub name: String,
    /// Its mass, kg.
    pub mass: f64,
    /// Number of shapes that a camera sees.
    pub visuals: usize,
    /// Number of shapes that touch.
    pub collisions: usize,
}

/// One joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointReport {
    /// Its name.
    pub name: String,
    /// Its type, as URDF names it.
    pub kind: &'static str,
    /// The link that it hangs on.
    pub parent: String,
    /// The link that it moves.
    pub child: String,
    /// `rad`, `m`, or empty.
    pub unit: &'static str,
    /// Least and greatest position, if it has limits.
    pub range: Option<[f64; 2]>,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Dry friction, N m or N.
    pub friction: f64,
}

/// One grasp hint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GraspReport {
    /// Its name.
    pub name: String,
    /// `bar` or `rim`.
    pub kind: &'static str,
    /// The link that is held.
    pub link: String,
    /// The width that the fingers close on, m.
    pub width: f64,
}

/// One region.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionReport {
    /// Its name.
    pub name: String,
    /// The link that it is fixed to.
    pub link: String,
    /// Full extents, m.
    pub size: [f64; 3],
}

/// `models verify`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VerifyReport {
    /// The object's name.
    pub name: String,
    /// The current version, if HEAD names one.
    pub version: Option<Version>,
    /// How many versions were held against their names.
    pub versions: usize,
    /// Is everything as it should be (no finding is an error)?
    pub sound: bool,
    /// What was found.
    pub findings: Vec<Finding>,
}

/// One thing that `verify` found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// The file, link, joint or entry.
    pub place: String,
    /// What is wrong, and what to do about it.
    pub message: String,
}

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// It may be meant so.
    Warning,
    /// The model must not be used like this.
    Error,
}

impl Library {
    /// All objects, sorted by name. One that cannot be read is listed with its problem.
    ///
    /// Errors: the library's folder cannot be read.
    pub fn list(&self) -> Result<Vec<ModelListing>, LibraryError> {
        Ok(self.names()?.iter().map(|name| self.listing(name)).collect())
    }

    fn listing(&self, name: &str) -> ModelListing {
        let versions = self.versions(name).map_or(0, |v| v.len());
        match self.get(name) {
            Ok(stored) => listing(name, &stored, versions),
            Err(problem) => ModelListing {
                name: name.to_owned(),
                version: self.head(name).ok(),
                versions,
                description: String::new(),
                category: String::new(),
                role: "",
                joints: Vec::new(),
                mass: 0.0,
                licence: String::new(),
                problem: Some(problem.to_string()),
            },
        }
    }

    /// Everything about an object's current version that a person wants to see.
    ///
    /// Errors: as [`Self::get`].
    pub fn report(&self, name: &str) -> Result<ModelReport, LibraryError> {
        let stored = self.get(name)?;
        let versions = self.versions(name)?;
        let model = &stored.model;
        let mut bytes = 0;
        for file in files(&model.folder)? {
            let path = model.folder.join(file);
            bytes += std::fs::metadata(&path).map_err(LibraryError::file(&path))?.len();
        }
        let evidence = |v: &Version| {
            let folder = self.home(name).map(|h| h.join(v.as_str()).join("evidence"));
            folder.ok().filter(|f| f.is_dir()).and_then(|f| files(&f).ok()).unwrap_or_default()
        };
        let all_versions = versions.iter().map(|v| VersionReport { version: v.clone(), head: *v == stored.version, evidence: evidence(v) });
        let link_name = |i: usize| model.links.get(i).map(|l| l.name.clone()).unwrap_or_default();
        Ok(ModelReport {
            listing: listing(name, &stored, versions.len()),
            folder: model.folder.display().to_string(),
            bytes,
            all_versions: all_versions.collect(),
            links: model
                .links
                .iter()
                .map(|l| LinkReport {
                    name: l.name.clone(),
                    mass: l.inertial.mass,
                    visuals: l.visuals.len(),
                    collisions: l.collisions.len(),
                })
                .collect(),
            joint_list: model
                .joints
                .iter()
                .map(|j| {
                    let (kind, unit) = kind(j.kind);
                    let limited = matches!(j.kind, JointKind::Revolute | JointKind::Prismatic);
                    JointReport {
                        name: j.name.clone(),
                        kind,
                        unit,
                        parent: link_name(j.parent),
                        child: link_name(j.child),
                        range: limited.then_some([j.limits.lower, j.limits.upper]),
                        damping: j.damping,
                        friction: j.friction,
                    }
                })
                .collect(),
            grasps: model
                .document
                .grasps
                .iter()
                .map(|g| {
                    let (kind, width) = match g {
                        GraspHint::Bar(b) => ("bar", 2.0 * b.radius),
                        GraspHint::Rim(r) => ("rim", r.thickness),
                    };
                    GraspReport { name: g.name().to_owned(), kind, link: g.link().to_owned(), width }
                })
                .collect(),
            regions: model
                .document
                .regions
                .iter()
                .map(|r| RegionReport { name: r.name.clone(), link: r.link.clone(), size: r.size })
                .collect(),
            effects: model.document.effects.clone(),
            configurations: model.document.robot.iter().flat_map(|r| &r.configurations).map(|c| c.name.clone()).collect(),
            provenance: model.document.provenance.clone(),
        })
    }

    /// Holds every version against its name, and looks through the current one: the model reads, its meshes are there and
    /// solid where they touch, its joints open as they should, its grasps and regions lie where its shapes say, its
    /// licence is there.
    ///
    /// Errors: there is no such object. What is wrong with an object is not an error but a finding.
    pub fn verify(&self, name: &str) -> Result<VerifyReport, LibraryError> {
        let home = self.home(name)?;
        let mut findings = Vec::new();
        let versions = self.versions(name)?;
        for version in &versions {
            let folder = home.join(version.as_str());
            match Version::of_folder(&folder) {
                Ok(found) if found == *version => {}
                Ok(found) => findings.push(Finding::error(version.as_str(), LibraryError::Corrupt { path: folder, found })),
                Err(e) => findings.push(Finding::error(version.as_str(), e)),
            }
        }
        findings.extend(check::home(&home)?);
        match self.get(name) {
            Ok(stored) => findings.extend(check::model(name, &stored.model, &stored.model.folder)?),
            // A changed version has been found above.
            Err(LibraryError::Corrupt { .. }) => {}
            Err(e) => findings.push(Finding::error("HEAD", e)),
        }
        findings.sort_by_key(|f| std::cmp::Reverse(f.severity));
        let sound = findings.iter().all(|f| f.severity != Severity::Error);
        Ok(VerifyReport { name: name.to_owned(), version: self.head(name).ok(), versions: versions.len(), sound, findings })
    }
}

impl Finding {
    pub(crate) fn error(place: impl Into<String>, message: impl ToString) -> Self {
        Self { severity: Severity::Error, place: place.into(), message: message.to_string() }
    }

    pub(crate) fn warning(place: impl Into<String>, message: impl ToString) -> Self {
        Self { severity: Severity::Warning, place: place.into(), message: message.to_string() }
    }
}

fn listing(name: &str, stored: &Stored, versions: usize) -> ModelListing {
    let model = &stored.model;
    let document = &model.document;
    ModelListing {
        name: name.to_owned(),
        version: Some(stored.version.clone()),
        versions,
        description: document.description.clone(),
        category: document.category.clone(),
        role: match (&document.robot, document.movable) {
            (Some(_), _) => "robot",
            (None, true) => "movable",
            (None, false) => "fixed",
        },
        joints: model.moving_joints().map(|i| model.joints[i].name.clone()).collect(),
        mass: model.links.iter().map(|l| l.inertial.mass).sum(),
        licence: document.provenance.licence.clone(),
        problem: None,
    }
}

fn kind(kind: JointKind) -> (&'static str, &'static str) {
    match kind {
        JointKind::Fixed => ("fixed", ""),
        JointKind::Revolute => ("revolute", "rad"),
        JointKind::Continuous => ("continuous", "rad"),
        JointKind::Prismatic => ("prismatic", "m"),
        JointKind::Floating => ("floating", ""),
        JointKind::Planar => ("planar", ""),
    }
}
