//! `scene.learn(name)`: a thing that nobody has told of is looked at, modelled from what the wrist's camera sees of it, kept in the library, and
//! believed to be in the scene from then on.
//!
//! Nothing but images goes in: the points that belong neither to the table nor to the robot nor to an object that is known already.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Point3, Vector6};
use sagci_library::Evidence;
use sagci_model::ObjectModel;
use sagci_modelling::{Lens, Perceived, Weights, perceive};
use sagci_perception::{View, unexplained};
use sagci_signal::ObjectBelief;
use sagci_skill::{Failure, FailureCode};
use sagci_world::recording::Level;

use super::live::{Live, Thing, broken};
use super::progress::Event;
use super::run::{Host, Phase};
use super::step::failure;
use crate::language::stage::{Refusal, Stop};
use crate::language::value::At;

/// Standard deviations of where a learned object stands: its own frame was read off the same points, m and rad.
const SHIFT: f64 = 0.003;
const TURN: f64 = 0.005;
/// Fewer points of it than this in all views say that there is nothing new.
const LEAST: usize = 200;
/// Who made a learned model, as its provenance says.
const MAKER: &str = "sagci perceive";

fn refuse<T>(message: String, hint: &str) -> Result<T, Stop> {
    Err(Stop::Refused(Refusal { message, hint: Some(hint.to_owned()) }))
}

fn unseen(message: String) -> Stop {
    let failure: Failure = failure(FailureCode::NotSeen, "learn", message);
    Stop::Failed(failure)
}

impl Host {
    pub(super) fn learn_object(&mut self, name: &str) -> Result<(), Stop> {
        if self.declared.get(name).is_some() {
            return refuse(format!("there is already a '{name}' in the scene"), "give what is learned another name");
        }
        let stored = self.kit.models.names().iter().any(|n| n == name);
        let made_here = |m: &ObjectModel| m.document.provenance.origins.iter().any(|o| o.source == MAKER);
        if stored && !self.kit.models.model(name).is_ok_and(|m| made_here(&m)) {
            let message = format!("the library has a model '{name}' that was not learned from a cloud");
            return refuse(message, "give what is learned another name");
        }
        if matches!(self.phase, Phase::Declaring) {
            self.begin()?;
        }
        let Phase::Live(live) = &mut self.phase else {
            return refuse(format!("'{name}' cannot be learned where nothing moves: no camera looks"), "run the script in a world");
        };
        live.progress.event(live.seed, &Event::Looking { objects: &[name.to_owned()] });
        let (cloud, views) = live.new_points()?;
        let weights = Weights::shipped().map_err(|e| broken("the networks of perception", e))?;
        let mut found = perceive(&cloud, name, &weights).map_err(|e| unseen(format!("{name}: {e}")))?;
        // What no view saw the end of is learned too small: whoever reads the journal ought to know.
        found.note_cut_offs(&cloud, &views.iter().map(seen_through).collect::<Vec<_>>());
        let standing = found.standing();
        let json = serde_json::to_string_pretty(&found.report).map_err(|e| broken("what was perceived", e))?;
        let evidence = [Evidence { name: "perception.json".into(), bytes: (json + "\n").into_bytes() }];
        let published = self.kit.models.publish(name, &standing, &evidence);
        let (version, model) = published.map_err(|e| broken("the library", e))?;
        if let Phase::Live(live) = &mut self.phase {
            if let Some(journal) = &live.journal {
                journal.log(Level::Info, "host", &said(name, &found));
            }
            live.come_to_know(name, model.clone(), &found);
            live.note_belief();
        }
        let place = found.X_WO.translation.vector;
        self.declared.learned(name, model.clone(), At { xy: [place.x, place.y], z: Some(place.z) });
        self.published.insert(name.to_owned(), (version, model));
        Ok(())
    }
}

/// Where a view's camera was, and its lens.
fn seen_through(view: &View) -> (Isometry3<f64>, Option<Lens>) {
    let image = &view.image;
    let size = [image.width as f64, image.height as f64];
    (view.X_WC, Some(Lens { size, focal: image.focal, center: image.center }))
}

/// What was found, in a line.
fn said(name: &str, found: &Perceived) -> String {
    let joints: Vec<String> = found.report.joints.iter().map(|j| format!("{} ({})", j.name, j.kind)).collect();
    let notes: String = found.report.notes.iter().map(|n| format!("; {n}")).collect();
    match joints.is_empty() {
        true => format!("{name} was learned as one rigid thing{notes}"),
        false => format!("{name} was learned with {}{notes}", joints.join(", ")),
    }
}

impl Live {
    /// What nobody has told of: from all around, then from nearer by.
    fn new_points(&mut self) -> Result<(Vec<Point3<f64>>, Vec<View>), Stop> {
        let mut views = self.views_around()?;
        let first = self.unexplained(&views)?;
        if first.len() < LEAST {
            let known = self.belief.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>().join(", ");
            let beside = if known.is_empty() { String::new() } else { format!(" besides {known}") };
            return Err(unseen(format!("nothing new is seen{beside}: {} points belong to nothing that is known", first.len())));
        }
        let middle = first.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / first.len() as f64;
        for q in self.aimed_at(&Point3::from(middle), None) {
            if self.move_to(&[q])?.is_ok() {
                views.push(self.view()?);
            }
        }
        let points = self.unexplained(&views)?;
        Ok((points, views))
    }

    fn unexplained(&self, views: &[View]) -> Result<Vec<Point3<f64>>, Stop> {
        let seen = |view: &View| {
            let known = self.belief.objects.iter().zip(&self.things).filter(|(o, _)| o.seen && o.X_TO.is_none());
            known.fold(view.clone(), |v, (o, t)| v.with_known(&t.model, &o.X_WO, &o.q))
        };
        let views: Vec<View> = views.iter().map(seen).collect();
        unexplained(&views, self.belief.table_height).map_err(|e| broken("perception", e))
    }

    /// Believes in what was learned.
    fn come_to_know(&mut self, name: &str, model: Arc<ObjectModel>, found: &Perceived) {
        let q: Vec<f64> = found.report.joints.iter().map(|j| j.state).collect();
        let deviations: Vector6<f64> = Vector6::new(TURN, TURN, TURN, SHIFT, SHIFT, SHIFT);
        let covariance = Matrix6::from_diagonal(&deviations.map(|d| d * d));
        let X_WO: Isometry3<f64> = found.X_WO;
        let folder = model.folder.clone();
        self.belief.objects.push(ObjectBelief { name: name.to_owned(), model: folder, X_WO, q, covariance, X_TO: None, seen: true });
        self.things.push(Thing { model, declared: None, home: None, released: false });
    }
}
