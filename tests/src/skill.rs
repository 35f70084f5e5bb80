//! Skills made up by a test.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use sagci_script::plugins::LoadedSkill;
use sagci_skill::{
    Execution, Failure, Manifest, ManifestError, Parameter, ParameterKind, Plan, PlanRequest, PlanSummary, Skill, StepInput, StepReply,
};

type Planner = dyn Fn(&PlanRequest) -> Result<PlanSummary, Failure> + Send + Sync;
type Stepper = dyn Fn(usize, &StepInput) -> StepReply + Send + Sync;

/// What a made-up skill does.
#[derive(Clone)]
pub struct Scripted {
    /// Its name.
    pub name: &'static str,
    /// Its parameters.
    pub parameters: Vec<(&'static str, ParameterKind, bool)>,
    /// Plans.
    pub plan: Arc<Planner>,
    /// Answers the n-th step.
    pub step: Arc<Stepper>,
}

/// A skill made up by a test; it keeps what it was asked.
pub struct ScriptedSkill {
    scripted: Scripted,
    /// All requests so far.
    pub asked: Mutex<Vec<PlanRequest>>,
}

impl Skill for ScriptedSkill {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        let parameters = self.scripted.parameters.iter();
        Ok(Manifest {
            name: self.scripted.name.to_owned(),
            version: "0.0.0".to_owned(),
            abi: sagci_skill::abi::ABI,
            summary: "Made up by a test".to_owned(),
            parameters: parameters
                .map(|(name, kind, required)| Parameter {
                    name: (*name).to_owned(),
                    kind: *kind,
                    required: *required,
                    summary: String::new(),
                })
                .collect(),
            library: "none".to_owned(),
            entry: "none".to_owned(),
        })
    }

    fn plan(&self, request: &PlanRequest, _: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        self.asked.lock().unwrap().push(request.clone());
        let summary = (self.scripted.plan)(request)?;
        Ok(Plan { summary, execution: Box::new(Running { step: self.scripted.step.clone(), count: 0 }) })
    }
}

struct Running {
    step: Arc<Stepper>,
    count: usize,
}

impl Execution for Running {
    fn step(&mut self, input: &StepInput) -> StepReply {
        self.count += 1;
        (self.step)(self.count - 1, input)
    }
}

/// A made-up skill as the host sees it, and the skill itself.
pub fn loaded(scripted: Scripted) -> (LoadedSkill, Arc<ScriptedSkill>) {
    let skill = Arc::new(ScriptedSkill { scripted, asked: Mutex::default() });
    let manifest = skill.manifest().unwrap();
    (LoadedSkill { manifest, sidecar: PathBuf::new(), library: PathBuf::new(), skill: skill.clone() }, skill)
}
