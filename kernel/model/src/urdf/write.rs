//! [`ObjectModel`] to URDF. Numbers are written so that they read back as the same bits; poses lose at most rounding,
//! since URDF has angles and the model has quaternions.

use std::fmt::Write;

use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};

use crate::{Geometry, JointKind, JointLimits, ObjectModel, Shape};

/// The text of the model's URDF. `mesh_name` gives each mesh's file name as it shall stand there.
pub(crate) fn to_urdf(model: &ObjectModel, mesh_name: impl Fn(&std::path::Path) -> String) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
    let uses_capsule = |s: &Shape| matches!(s.geometry, Geometry::Capsule { .. });
    let capsules = model.links.iter().any(|l| l.visuals.iter().chain(&l.collisions).any(uses_capsule));
    // Capsules came with URDF 1.1.
    let version = if capsules { " version=\"1.1\"" } else { "" };
    // Writing to a String cannot fail: the results of write! are passed over throughout.
    let _ = writeln!(out, "<robot name=\"{}\"{version}>", escape(&model.name));
    for link in &model.links {
        let _ = writeln!(out, "  <link name=\"{}\">", escape(&link.name));
        if link.inertial.mass > 0.0 {
            let p = link.inertial.p_LoLcm.coords;
            let _ = writeln!(out, "    <inertial>\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>", numbers(p.as_slice()));
            let _ = writeln!(
                out,
                "      <mass value=\"{}\"/>\n      {}\n    </inertial>",
                link.inertial.mass,
                inertia(&link.inertial.I_LLcm_L)
            );
        }
        for (tag, shapes) in [("visual", &link.visuals), ("collision", &link.collisions)] {
            for s in shapes {
                shape(&mut out, tag, s, &mesh_name);
            }
        }
        out.push_str("  </link>\n");
    }
    for (i, j) in model.joints.iter().enumerate() {
        let kind = match j.kind {
            JointKind::Fixed => "fixed",
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
            JointKind::Floating => "floating",
            JointKind::Planar => "planar",
        };
        let _ = writeln!(out, "  <joint name=\"{}\" type=\"{kind}\">\n    {}", escape(&j.name), origin(&j.X_PJ));
        let (parent, child) = (&model.links[j.parent].name, &model.links[j.child].name);
        let _ = writeln!(out, "    <parent link=\"{}\"/>\n    <child link=\"{}\"/>", escape(parent), escape(child));
        if !matches!(j.kind, JointKind::Fixed | JointKind::Floating) {
            let _ = writeln!(out, "    <axis xyz=\"{}\"/>", numbers(j.axis.as_slice()));
        }
        if matches!(j.kind, JointKind::Revolute | JointKind::Prismatic) {
            let JointLimits { lower, upper, velocity, effort } = j.limits;
            let _ = writeln!(out, "    <limit lower=\"{lower}\" upper=\"{upper}\" velocity=\"{velocity}\" effort=\"{effort}\"/>");
        }
        let [damping, friction] = crate::stated::of_joint(model, i);
        if damping != 0.0 || friction != 0.0 {
            let _ = writeln!(out, "    <dynamics damping=\"{damping}\" friction=\"{friction}\"/>");
        }
        if let Some(m) = &j.mimic {
            let followed = escape(&model.joints[m.joint].name);
            let _ = writeln!(out, "    <mimic joint=\"{followed}\" multiplier=\"{}\" offset=\"{}\"/>", m.multiplier, m.offset);
        }
        out.push_str("  </joint>\n");
    }
    out.push_str("</robot>\n");
    out
}

fn shape(out: &mut String, tag: &str, s: &Shape, mesh_name: &impl Fn(&std::path::Path) -> String) {
    let name = s.name.as_ref().map(|n| format!(" name=\"{}\"", escape(n))).unwrap_or_default();
    let geometry = match &s.geometry {
        Geometry::Box { half_extents } => format!("<box size=\"{}\"/>", numbers((half_extents * 2.0).as_slice())),
        Geometry::Sphere { radius } => format!("<sphere radius=\"{radius}\"/>"),
        Geometry::Cylinder { radius, half_length } => format!("<cylinder radius=\"{radius}\" length=\"{}\"/>", half_length * 2.0),
        Geometry::Capsule { radius, half_length } => format!("<capsule radius=\"{radius}\" length=\"{}\"/>", half_length * 2.0),
        Geometry::Mesh { file, scale, .. } => {
            let scale = if *scale == Vector3::repeat(1.0) { String::new() } else { format!(" scale=\"{}\"", numbers(scale.as_slice())) };
            format!("<mesh filename=\"{}\"{scale}/>", escape(&mesh_name(file)))
        }
    };
    let material = match s.rgba {
        Some(rgba) => {
            let rgba = numbers(&rgba);
            let material = format!("<material name=\"rgba {rgba}\"><color rgba=\"{rgba}\"/></material>");
            material
        }
        None => String::new(),
    };
    let _ = writeln!(out, "    <{tag}{name}>{}<geometry>{geometry}</geometry>{material}</{tag}>", origin(&s.X_LG));
}

fn origin(X: &Isometry3<f64>) -> String {
    format!("<origin xyz=\"{}\" rpy=\"{}\"/>", numbers(X.translation.vector.as_slice()), numbers(&rpy(X)))
}

/// Roll, pitch and yaw of R = Rz(yaw) Ry(pitch) Rx(roll). The yaw is taken out before roll and pitch are read off, so that
/// their product is R to rounding also where the pitch is near a right angle and roll and yaw cannot be told apart.
fn rpy(X: &Isometry3<f64>) -> [f64; 3] {
    let R = X.rotation.to_rotation_matrix();
    let yaw = R[(1, 0)].atan2(R[(0, 0)]);
    let P = Rotation3::from_axis_angle(&Vector3::z_axis(), -yaw) * R;
    [(-P[(1, 2)]).atan2(P[(1, 1)]), (-P[(2, 0)]).atan2(P[(0, 0)]), yaw]
}

fn inertia(I: &Matrix3<f64>) -> String {
    let n = |i: usize, j: usize| I[(i, j)];
    format!(
        "<inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>",
        n(0, 0),
        n(0, 1),
        n(0, 2),
        n(1, 1),
        n(1, 2),
        n(2, 2)
    )
}

/// Numbers with as many digits as they need to be read back as the same bits; minus zero is written as zero.
fn numbers(values: &[f64]) -> String {
    values.iter().map(|v| (v + 0.0).to_string()).collect::<Vec<_>>().join(" ")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
