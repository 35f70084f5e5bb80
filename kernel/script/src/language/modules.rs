//! `import`: modules are Rhai files in the script's own folder or below it, and nowhere else.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use rhai::{Dynamic, Engine, EvalAltResult, Module, ModuleResolver, Position, Scope, Shared};

use super::engine::Termination;
use super::stage::Refusal;

/// The file of a module. `Err` says why there is none.
pub fn locate(folder: &Path, path: &str) -> Result<PathBuf, String> {
    let relative = Path::new(path);
    if path.is_empty() || !relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        return Err("modules lie in the script's folder or below it: give a relative path without '..'".to_owned());
    }
    let mut file = folder.join(relative);
    if file.extension().is_none_or(|e| e != "rhai") {
        file.as_mut_os_string().push(".rhai");
    }
    let found = file.canonicalize().map_err(|e| format!("{}: {e}", file.display()))?;
    let folder = folder.canonicalize().map_err(|e| format!("{}: {e}", folder.display()))?;
    // A link could still lead out.
    if found.starts_with(&folder) { Ok(found) } else { Err(format!("{} lies outside the script's folder", found.display())) }
}

/// Resolves modules within one folder.
pub struct ConfinedModules {
    folder: PathBuf,
    done: RefCell<BTreeMap<PathBuf, Shared<Module>>>,
    loading: RefCell<Vec<PathBuf>>,
}

impl ConfinedModules {
    /// Modules of the scripts in `folder`.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), done: RefCell::default(), loading: RefCell::default() }
    }
}

impl ModuleResolver for ConfinedModules {
    fn resolve(&self, engine: &Engine, _: Option<&str>, path: &str, pos: Position) -> Result<Shared<Module>, Box<EvalAltResult>> {
        // It cannot be caught, and its place is that of the import.
        let refuse = |message: String| {
            let message = format!("the module \"{path}\" cannot be imported: {message}");
            let refusal = Dynamic::from(Termination::Refused(Refusal { message, hint: None }));
            EvalAltResult::ErrorInModule(path.to_owned(), EvalAltResult::ErrorTerminated(refusal, Position::NONE).into(), pos)
        };
        let file = locate(&self.folder, path).map_err(refuse)?;
        if let Some(module) = self.done.borrow().get(&file) {
            return Ok(module.clone());
        }
        if self.loading.borrow().contains(&file) {
            return Err(refuse(format!("{} imports itself", file.display())).into());
        }
        self.loading.borrow_mut().push(file.clone());
        let module = engine.compile_file(file.clone()).and_then(|mut ast| {
            ast.set_source(file.to_string_lossy().as_ref());
            Module::eval_ast_as_new(Scope::new(), &ast, engine)
        });
        self.loading.borrow_mut().pop();
        let module: Shared<Module> = module.map_err(|e| Box::new(EvalAltResult::ErrorInModule(path.to_owned(), e, pos)))?.into();
        self.done.borrow_mut().insert(file, module.clone());
        Ok(module)
    }
}
