//! Contact between the bodies of a system: shapes, contact points, the law at each point, grasps, and their derivatives.
//!
//! A step takes contact points at its old state ([`geometry`], [`shapes`], [`polytope`]) and finds the next velocities and all impulses in one
//! strictly convex problem ([`solver`]), with the exact dry friction and limits of the joints ([`crate::complementarity`]):
//!
//! `minimise  (w - v*)^T A (w - v*) / 2 + sum_c l_c(J_c w) + sum_k phi_k(w_k)`.
//!
//! Each `l_c` is the potential of a contact point ([`cone`]) or of a grasp ([`grasp`]). The point's wrench at the world's origin is
//! `F = [p x f; f]` on body A, and the opposite on B. All contacts between two bodies share one relative Jacobian, whose columns are
//! those joints that move one of the bodies and not the other; contacts are added up as 6 x 6 matrices before they meet it.
//!
//! Derivatives of the step are in [`derivative`].

pub(crate) mod cone;
pub(crate) mod derivative;
pub(crate) mod feature;
pub(crate) mod geometry;
pub(crate) mod grasp;
pub(crate) mod point;
pub(crate) mod polytope;
pub(crate) mod shapes;
pub(crate) mod solver;

use nalgebra::{Isometry3, Matrix3, UnitVector3, Vector3};

pub use grasp::Grasp;

use self::geometry::{Geometry, Pair, Solid};
use self::point::POINTS;
use crate::joint::matrix;
use crate::{DynamicsError, LinkId, Multibody, Part, System};

/// What a surface is like.
///
/// Of two surfaces, the stiffnesses act in series, `k = k1 k2 / (k1 + k2)`; the dissipation is that of springs with losses in series,
/// `c = (k2 c1 + k1 c2) / (k1 + k2)`; and the friction is `mu = 2 mu1 mu2 / (mu1 + mu2)`, which is smooth, never more than twice the
/// smaller, and zero where one is zero. (The rules of Drake.)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactMaterial {
    /// Stiffness of one contact point, N/m.
    pub stiffness: f64,
    /// Hunt-Crossley dissipation, s/m: a part `1 - dissipation v` of the force is felt at the speed `v` of parting.
    pub dissipation: f64,
    /// Coulomb's coefficient.
    pub friction: f64,
}

impl Default for ContactMaterial {
    /// 2e6 N/m (1e6 N/m between two such surfaces), 10 s/m, 0.5.
    fn default() -> Self {
        Self { stiffness: 2e6, dissipation: 10.0, friction: 0.5 }
    }
}

impl ContactMaterial {
    pub(crate) fn check(&self, place: &str) -> Result<(), DynamicsError> {
        let bounds = [("stiffness", self.stiffness, self.stiffness > 0.0), ("dissipation", self.dissipation, self.dissipation >= 0.0)];
        for (name, value, good) in bounds.into_iter().chain([("friction", self.friction, self.friction >= 0.0)]) {
            if !good || !value.is_finite() {
                let must = if name == "stiffness" { "positive and finite" } else { "finite and not negative" };
                return Err(DynamicsError::OutOfBounds { what: format!("contact {name} of '{place}'"), value, must: must.into() });
            }
        }
        Ok(())
    }

    /// What acts between two surfaces.
    pub fn between(&self, other: &Self) -> Self {
        let (k, l) = (self.stiffness, other.stiffness);
        let (mu, nu) = (self.friction, other.friction);
        Self {
            stiffness: k * l / (k + l),
            dissipation: (l * self.dissipation + k * other.dissipation) / (k + l),
            friction: if mu + nu > 0.0 { 2.0 * mu * nu / (mu + nu) } else { 0.0 },
        }
    }

    /// Derivatives of [`Self::between`] by this surface: rows stiffness, dissipation, friction of the pair; columns those of this
    /// surface.
    pub fn between_by_self(&self, other: &Self) -> Matrix3<f64> {
        let (k, l) = (self.stiffness, other.stiffness);
        let (mu, nu) = (self.friction, other.friction);
        let s = k + l;
        let friction = if mu + nu > 0.0 { 2.0 * nu * nu / ((mu + nu) * (mu + nu)) } else { 0.0 };
        Matrix3::new(l * l / (s * s), 0.0, 0.0, l * (other.dissipation - self.dissipation) / (s * s), l / s, 0.0, 0.0, 0.0, friction)
    }
}

/// How contacts are found and taken over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactOptions {
    /// Material of all surfaces that are not given their own.
    pub material: ContactMaterial,
    /// Surfaces nearer than this take part in a step (they push only if they meet within it), m. Bodies that close in faster than
    /// `margin / step` overlap before they feel each other.
    pub margin: f64,
    /// Speed up to which friction holds, m/s: a body at rest on a slope creeps by at most this.
    pub slip: f64,
    /// Part of the step over which depths are taken ahead, 0 to 1. At 1 (as given by default) any stiffness is stable and impacts lose
    /// energy to the step. At 0, with no dissipation and a step well below `sqrt(mass / stiffness)`, impacts are elastic.
    pub share: f64,
}

impl Default for ContactOptions {
    fn default() -> Self {
        Self { material: ContactMaterial::default(), margin: 1e-3, slip: 1e-6, share: 1.0 }
    }
}

impl ContactOptions {
    fn check(&self) -> Result<(), DynamicsError> {
        self.material.check("the options")?;
        let bounds = [
            ("margin", self.margin, self.margin >= 0.0, "finite and not negative"),
            ("slip", self.slip, self.slip > 0.0, "positive and finite"),
            ("share", self.share, (0.0..=1.0).contains(&self.share), "between 0 and 1"),
        ];
        for (name, value, good, must) in bounds {
            if !good || !value.is_finite() {
                return Err(DynamicsError::OutOfBounds { what: format!("contact {name}"), value, must: must.into() });
            }
        }
        Ok(())
    }
}

/// One degree of freedom of the tree that moves a pair of bodies against each other.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    /// Its velocity, its column of the motion subspace, and the sign with which it counts.
    pub v: usize,
    pub tree: usize,
    pub factor: f64,
    /// Whether it moves A, and the body of its joint.
    pub moves_a: bool,
    pub body: usize,
}

/// Two bodies with the degrees of freedom between them.
#[derive(Debug, Clone)]
pub(crate) struct Group {
    pub a: usize,
    pub b: usize,
    /// From the root outward, first those of A, then those of B.
    pub columns: Vec<Column>,
    /// Where its columns stand among all.
    pub start: usize,
}

/// Shapes, pairs and grasps of a system.
#[derive(Debug, Clone)]
pub(crate) struct Contacts {
    pub options: ContactOptions,
    pub geometries: Vec<Geometry>,
    pub excluded: Vec<[usize; 2]>,
    pub pairs: Vec<Pair>,
    /// Group of each pair, then of each grasp.
    pub group_of: Vec<usize>,
    pub groups: Vec<Group>,
    pub grasps: Vec<Grasp>,
    pub columns: usize,
}

impl Contacts {
    fn new(options: ContactOptions, geometries: Vec<Geometry>) -> Self {
        Self { options, geometries, excluded: vec![], pairs: vec![], group_of: vec![], groups: vec![], grasps: vec![], columns: 0 }
    }

    fn rebuild(&mut self, multibody: &Multibody) {
        self.pairs = geometry::pairs(multibody, &self.geometries, &self.excluded);
        (self.groups, self.group_of, self.columns) = (Vec::new(), Vec::new(), 0);
        let bodies = self.pairs.iter().map(|p| (self.geometries[p.a].body, self.geometries[p.b].body));
        let held = self.grasps.iter().map(|g| (multibody.frames[g.a.0].body, multibody.frames[g.b.0].body));
        for (a, b) in bodies.chain(held).collect::<Vec<_>>() {
            let known = self.groups.iter().position(|g| g.a == a && g.b == b);
            self.group_of.push(known.unwrap_or(self.groups.len()));
            if known.is_none() {
                let columns = columns(multibody, a, b);
                let start = self.columns;
                self.columns += columns.len();
                self.groups.push(Group { a, b, columns, start });
            }
        }
    }

    /// Most contact points that there can be.
    pub fn room(&self) -> usize {
        POINTS * self.pairs.len()
    }
}

fn columns(multibody: &Multibody, a: usize, b: usize) -> Vec<Column> {
    let chain = |mut body: usize| {
        let mut out = Vec::new();
        while body != 0 {
            out.push(body);
            body = multibody.bodies[body].parent;
        }
        out.reverse();
        out
    };
    let (of_a, of_b) = (chain(a), chain(b));
    let shared = of_a.iter().zip(&of_b).take_while(|(x, y)| x == y).count();
    let mut out = Vec::new();
    for (bodies, moves_a) in [(&of_a[shared..], true), (&of_b[shared..], false)] {
        for &i in bodies {
            let body = &multibody.bodies[i];
            for k in 0..body.nv {
                let factor = if moves_a { 1.0 } else { -1.0 };
                out.push(Column { v: body.v + k, tree: body.tree + k, factor, moves_a, body: i });
            }
        }
    }
    out
}

/// A contact point of the last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint<'a> {
    /// What touches: `part/link`, or the name of a plane.
    pub a: &'a str,
    /// And the other.
    pub b: &'a str,
    /// The point in the world, m, half way between the surfaces.
    pub p_W: Vector3<f64>,
    /// Normal from B to A.
    pub n_W: Vector3<f64>,
    /// Overlap at the start of the step, m; negative across a gap.
    pub depth: f64,
    /// Impulse on A over the step, N s.
    pub impulse_W: Vector3<f64>,
    /// Whether friction holds it.
    pub sticks: bool,
    /// Names the corners and edges that make it, the same from step to step.
    pub id: u32,
}

impl System {
    /// Lets the collision shapes of all links touch. `parts` are those that the system was made from.
    ///
    /// Which pairs are tested: all but shapes that no joint moves against each other and links that a joint joins.
    /// Where two bodies overlap, they are parted along the shortest way; two balls with one centre upwards.
    ///
    /// # Errors
    /// Options out of their bounds; a shape with a length that is not positive; a mesh with a part that has no volume; other parts.
    pub fn with_contacts(mut self, parts: &[Part<'_>], options: ContactOptions) -> Result<Self, DynamicsError> {
        options.check()?;
        let geometries = geometry::of_parts(self.multibody(), parts, &options)?;
        let mut contacts = Contacts::new(options, geometries);
        contacts.rebuild(self.multibody());
        self.contacts = Some(Box::new(contacts));
        Ok(self)
    }

    /// Adds a half space that is fixed to the world: it fills what lies below the plane through `p_W` with normal `n_W`.
    ///
    /// # Errors
    /// A material out of its bounds; a point or normal that is not finite.
    pub fn add_ground(
        &mut self,
        name: &str,
        p_W: Vector3<f64>,
        n_W: UnitVector3<f64>,
        material: ContactMaterial,
    ) -> Result<(), DynamicsError> {
        let rotation = nalgebra::UnitQuaternion::rotation_between(&Vector3::z(), &n_W)
            .unwrap_or_else(|| nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let X_WG = Isometry3::from_parts(p_W.into(), rotation);
        let plane = Geometry::new(name.into(), 0, (None, None), &X_WG, Solid::Plane, material)?;
        self.change_contacts(|c| c.geometries.push(plane));
        Ok(())
    }

    /// Gives all shapes of a link a material.
    ///
    /// # Errors
    /// A material out of its bounds; a link without shapes (or a system without contacts).
    pub fn set_contact_material(&mut self, link: LinkId, material: ContactMaterial) -> Result<(), DynamicsError> {
        let name = self.multibody().links().find(|l| l.0 == link).map_or_else(String::new, |l| format!("{}/{}", l.1, l.2));
        material.check(&name)?;
        let mut found = false;
        for g in self.contacts.iter_mut().flat_map(|c| &mut c.geometries).filter(|g| g.frame == Some(link.0)) {
            g.material = material;
            found = true;
        }
        let message = "has no shape that can touch; give its link a collision shape and the system contacts".into();
        if found { Ok(()) } else { Err(DynamicsError::Shape { place: name, message }) }
    }

    /// Lets two links pass through each other.
    pub fn exclude_contact(&mut self, a: LinkId, b: LinkId) {
        self.change_contacts(|c| c.excluded.push([a.0, b.0]));
    }

    /// Adds a compliant grasp between two links.
    ///
    /// # Errors
    /// A stiffness, damping or limit that is negative or not a number; a pose that is not finite; a link held by its own body.
    pub fn add_grasp(&mut self, grasp: Grasp) -> Result<(), DynamicsError> {
        geometry::check_pose("the pose of the grasp's frame on A", &grasp.X_AG)?;
        geometry::check_pose("the pose of the grasp's frame on B", &grasp.X_BH)?;
        let numbers = grasp.stiffness.iter().chain(grasp.damping.iter()).map(|x| (*x, x.is_finite()));
        for (value, finite) in numbers.chain(grasp.limit.iter().map(|x| (*x, true))) {
            if !(value >= 0.0 && finite) {
                return Err(DynamicsError::OutOfBounds {
                    what: "a number of the grasp".into(),
                    value,
                    must: "finite and not negative".into(),
                });
            }
        }
        let frames = &self.multibody().frames;
        let (a, b) = (&frames[grasp.a.0], &frames[grasp.b.0]);
        if a.body == b.body {
            let message = format!("is fixed to '{}' and cannot be held by it", b.name);
            return Err(DynamicsError::Shape { place: a.name.clone(), message });
        }
        self.change_contacts(|c| c.grasps.push(grasp));
        Ok(())
    }

    /// Removes all grasps.
    pub fn release_grasps(&mut self) {
        self.change_contacts(|c| c.grasps.clear());
    }

    fn change_contacts(&mut self, change: impl FnOnce(&mut Contacts)) {
        let mut contacts = self.contacts.take().unwrap_or_else(|| Box::new(Contacts::new(ContactOptions::default(), vec![])));
        change(&mut contacts);
        contacts.rebuild(self.multibody());
        self.contacts = Some(contacts);
        self.changed();
    }

    /// Puts shapes where their links are.
    pub(crate) fn place_shapes(&mut self) {
        for geometry in self.contacts.iter_mut().flat_map(|c| &mut c.geometries) {
            geometry.place(&self.multibody);
        }
    }
}

/// Pose of a grasp's frame in the world.
pub(crate) fn frame_in_world(
    multibody: &Multibody,
    link: LinkId,
    X_LF: &Isometry3<f64>,
    R_WB: &[Matrix3<f64>],
    p_WB: &[Vector3<f64>],
) -> (Matrix3<f64>, Vector3<f64>) {
    let frame = &multibody.frames[link.0];
    let X_BF = frame.X_BL * X_LF;
    let R = &R_WB[frame.body];
    (R * matrix(&X_BF.rotation), p_WB[frame.body] + R * X_BF.translation.vector)
}
