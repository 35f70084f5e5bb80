use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

/// The six kinds of object of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Category {
    /// Boxes, chests and cartons.
    Box,
    /// Doors in a frame.
    Door,
    /// Microwave ovens.
    Microwave,
    /// Ovens and cookers.
    Oven,
    /// Refrigerators.
    Refrigerator,
    /// Cupboards, chests of drawers, wardrobes, desks.
    Storage,
}

impl Category {
    /// All of them, in the paper's order.
    pub const ALL: [Self; 6] = [Self::Box, Self::Door, Self::Microwave, Self::Oven, Self::Refrigerator, Self::Storage];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Door => "door",
            Self::Microwave => "microwave",
            Self::Oven => "oven",
            Self::Refrigerator => "refrigerator",
            Self::Storage => "storage",
        }
    }
}

/// What a part is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// What stands still.
    Body,
    /// A panel on an upright hinge, or one that slides sideways.
    Door,
    /// A front with a box behind it that is pulled out.
    Drawer,
    /// A panel on top, hinged at an edge.
    Lid,
    /// A panel on a level hinge that stands upright when shut.
    Flap,
}

/// How a part moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A turn about an axis.
    Revolute,
    /// A slide along an axis.
    Prismatic,
}

/// The form of a solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// A box.
    Box,
    /// A cylinder along this axis of the part (0, 1, 2) that fills its box.
    Cylinder(usize),
}

/// A box or cylinder with sides along its part's axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Centre in F while the part is shut, m.
    pub center: Point3<f64>,
    /// Half extents, m.
    pub half: Vector3<f64>,
    /// Its form.
    pub form: Form,
    /// Share of rays that come back without a depth: dark glass, chrome.
    pub dropout: f64,
}

impl Solid {
    /// The box between two corners.
    pub fn between(low: [f64; 3], high: [f64; 3]) -> Self {
        let (low, high) = (Vector3::from(low), Vector3::from(high));
        Self { center: Point3::from((low + high) / 2.0), half: (high - low).abs() / 2.0, form: Form::Box, dropout: 0.0 }
    }

    /// A cylinder about a centre along axis 0, 1 or 2.
    pub fn cylinder(center: [f64; 3], axis: usize, radius: f64, half_length: f64) -> Self {
        let mut half = Vector3::repeat(radius);
        half[axis.min(2)] = half_length;
        Self { center: Point3::from(center), half, form: Form::Cylinder(axis.min(2)), dropout: 0.0 }
    }

    /// The same with a share of rays that get lost.
    pub fn dark(mut self, dropout: f64) -> Self {
        self.dropout = dropout;
        self
    }
}

/// One rigid part.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// What it is.
    pub class: Class,
    /// What it is made of.
    pub solids: Vec<Solid>,
}

/// How a part moves in the body, and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// The part, an index into [`Object::parts`].
    pub part: usize,
    /// Turn or slide.
    pub kind: Kind,
    /// Direction in F; positive motion opens.
    pub axis: Unit<Vector3<f64>>,
    /// A point on the axis, in F, m.
    pub origin: Point3<f64>,
    /// Most that it opens, rad or m; the least is zero.
    pub upper: f64,
    /// Where it stands, rad or m.
    pub state: f64,
}

impl Joint {
    /// Pose of the part in F at a position; the identity at zero.
    pub fn X_FP(&self, q: f64) -> Isometry3<f64> {
        match self.kind {
            Kind::Prismatic => Isometry3::from_parts(Translation3::from(self.axis.into_inner() * q), UnitQuaternion::identity()),
            Kind::Revolute => {
                let R = UnitQuaternion::from_axis_angle(&self.axis, q);
                Isometry3::from_parts(Translation3::from(self.origin.coords - R * self.origin.coords), R)
            }
        }
    }
}

/// An articulated object: what is true of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Which kind.
    pub category: Category,
    /// Name of its family.
    pub family: &'static str,
    /// `parts[0]` is the body.
    pub parts: Vec<Part>,
    /// One for each part but the body, in the order of parts.
    pub joints: Vec<Joint>,
}

impl Object {
    /// Pose of each part in F in its present state.
    pub fn X_FP(&self) -> Vec<Isometry3<f64>> {
        let mut poses = vec![Isometry3::identity(); self.parts.len()];
        for joint in &self.joints {
            poses[joint.part] = joint.X_FP(joint.state);
        }
        poses
    }

    /// Least and greatest corner in F of all parts as they stand, m.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for (part, X_FP) in self.parts.iter().zip(self.X_FP()) {
            for solid in &part.solids {
                for corner in 0..8 {
                    let sign = |k: usize| if corner >> k & 1 == 1 { 1.0 } else { -1.0 };
                    let p = X_FP * (solid.center + solid.half.component_mul(&Vector3::new(sign(0), sign(1), sign(2))));
                    low = low.inf(&p);
                    high = high.sup(&p);
                }
            }
        }
        (low, high)
    }

    /// The same object, larger or smaller.
    pub fn scaled(mut self, factor: f64) -> Self {
        for solid in self.parts.iter_mut().flat_map(|p| &mut p.solids) {
            solid.center *= factor;
            solid.half *= factor;
        }
        for joint in &mut self.joints {
            joint.origin *= factor;
            if joint.kind == Kind::Prismatic {
                joint.upper *= factor;
                joint.state *= factor;
            }
        }
        self
    }

    /// Length of the diagonal of its bounds, m.
    pub fn diagonal(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).norm()
    }
}
