//! Reads a script without running it and says what is certainly wrong in it.
//!
//! Rhai looks a function up when it is called, so a misspelt one would be found with the robot half way through its task.
//! This walks the syntax tree against what is registered: variables, functions and their number of arguments, skills with
//! the names and kinds of theirs, and the objects, joints and regions that are written as plain texts. Of each expression
//! it guesses what it will be; where it cannot know, it says nothing, so that everything it reports is wrong indeed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rhai::{AST, ASTNode, Engine, Expr, FnCallExpr, Position, Stmt, Token};
use sagci_model::{JointKind, ObjectModel};

use super::bind::{Given, bind};
use super::engine::{EXPECT_HINT, LEARN_HINT, Nowhere, SCENE, Surroundings, engine, known_functions};
use super::gap::{GAP_HINT, GAP_OPTIONS};
use super::modules::locate;
use super::suggest::{did_you_mean, hint_among};
use super::value::{ANGLE_UNITS, Kind, LENGTH_UNITS};
use crate::plugins::SkillSet;
use crate::{Diagnostic, Models};

/// What is wrong in a script and the modules that it imports; nothing, if all is well as far as can be seen.
pub fn check(script: &Path, skills: &SkillSet, models: &dyn Models) -> Vec<Diagnostic> {
    let folder = folder_of(script);
    let stage = std::rc::Rc::new(std::cell::RefCell::new(Nowhere));
    let engine = engine(&folder, Surroundings { skills: skills.loaded.clone(), stage, cancel: Arc::default() });
    let mut seen = BTreeSet::new();
    let mut problems = Vec::new();
    check_file(script, &Known { engine: &engine, functions: known_functions(&engine), skills, models, folder }, &mut seen, &mut problems);
    problems.sort();
    problems.dedup();
    problems
}

/// The folder of a script; its modules lie there.
pub fn folder_of(script: &Path) -> PathBuf {
    script.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

/// What is known before a script is read.
struct Known<'a> {
    engine: &'a Engine,
    functions: Vec<(String, usize)>,
    skills: &'a SkillSet,
    models: &'a dyn Models,
    folder: PathBuf,
}

/// Checks one file and answers its functions.
fn check_file(file: &Path, known: &Known<'_>, seen: &mut BTreeSet<PathBuf>, problems: &mut Vec<Diagnostic>) -> Vec<(String, usize)> {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(e) => {
            let message = format!("cannot be read: {e}");
            problems.push(Diagnostic {
                file: file.to_owned(),
                place: None,
                message,
                hint: Some("give the path of a .rhai file".to_owned()),
            });
            return Vec::new();
        }
    };
    let ast = match known.engine.compile(&text) {
        Ok(ast) => ast,
        Err(e) => {
            problems.push(Diagnostic::at(file, e.position(), e.err_type().to_string(), None));
            return Vec::new();
        }
    };
    let functions: Vec<(String, usize)> = ast.iter_functions().map(|f| (f.name.to_owned(), f.params.len())).collect();
    if !seen.insert(file.canonicalize().unwrap_or_else(|_| file.to_owned())) {
        return functions;
    }
    let mut checker = Checker {
        file,
        known,
        functions: functions.clone(),
        scopes: vec![Vec::new()],
        aliases: Vec::new(),
        declared: Vec::new(),
        seen,
        problems,
    };
    checker.whole(&ast);
    functions
}

/// What an expression will be, as far as can be seen.
#[derive(Clone)]
struct Guess {
    kind: Option<Kind>,
    facts: Facts,
}

#[derive(Clone)]
enum Facts {
    None,
    Text(String),
    Object(Arc<ObjectModel>),
    Map(Vec<(String, Guess, Position)>),
}

impl Guess {
    const UNKNOWN: Self = Self { kind: None, facts: Facts::None };

    fn of(kind: Kind) -> Self {
        Self { kind: Some(kind), facts: Facts::None }
    }

    fn text(&self) -> Option<&str> {
        match &self.facts {
            Facts::Text(text) => Some(text),
            _ => None,
        }
    }
}

struct Checker<'a> {
    file: &'a Path,
    known: &'a Known<'a>,
    functions: Vec<(String, usize)>,
    scopes: Vec<Vec<(String, Guess)>>,
    /// Imported modules, with their functions if they could be read.
    aliases: Vec<(String, Option<Vec<(String, usize)>>)>,
    /// Names of objects that are declared so far.
    declared: Vec<String>,
    seen: &'a mut BTreeSet<PathBuf>,
    problems: &'a mut Vec<Diagnostic>,
}

impl Checker<'_> {
    fn whole(&mut self, ast: &AST) {
        self.statements(ast.statements());
        let functions: Vec<(String, Vec<String>)> =
            ast.iter_functions().map(|f| (f.name.to_owned(), f.params.iter().map(|p| (*p).to_owned()).collect())).collect();
        for (name, parameters) in functions {
            self.name_is_free(&name, Position::NONE);
            // A function sees its parameters and nothing of the script's variables.
            let outer = std::mem::replace(&mut self.scopes, vec![parameters.iter().map(|p| (p.clone(), Guess::UNKNOWN)).collect()]);
            let mut body = ast.clone_functions_only();
            body.retain_functions(|_, _, n, arity| n == name && arity == parameters.len());
            body.walk(&mut |path: &[ASTNode<'_>]| {
                if let [ASTNode::Stmt(statement)] = path {
                    self.statement(statement);
                }
                true
            });
            self.scopes = outer;
        }
    }

    fn problem(&mut self, position: Position, message: impl Into<String>, hint: Option<String>) {
        self.problems.push(Diagnostic::at(self.file, position, message, hint));
    }

    fn define(&mut self, name: &str, guess: Guess) {
        if let Some(scope) = self.scopes.last_mut() {
            scope.push((name.to_owned(), guess));
        }
    }

    /// A script must not give a skill's name, or the scene's, another meaning.
    fn name_is_free(&mut self, name: &str, position: Position) {
        if name == SCENE {
            self.problem(position, format!("'{SCENE}' already means the scene"), Some("choose another name".to_owned()));
        } else if self.known.skills.get(name).is_some() {
            self.problem(position, format!("'{name}' is already the name of a skill"), Some("choose another name".to_owned()));
        }
    }

    fn block(&mut self, statements: &[Stmt]) {
        self.scopes.push(Vec::new());
        self.statements(statements);
        self.scopes.pop();
    }

    fn statements(&mut self, statements: &[Stmt]) {
        for statement in statements {
            self.statement(statement);
        }
    }

    fn statement(&mut self, statement: &Stmt) {
        match statement {
            Stmt::Var(x, _, position) => {
                let (ident, value, _) = &**x;
                let guess = self.guess(value);
                if ident.name.as_str() == SCENE {
                    self.name_is_free(&ident.name, *position);
                }
                self.define(&ident.name, guess);
            }
            Stmt::Assignment(x) => {
                let (operator, sides) = &**x;
                let value = self.guess(&sides.rhs);
                self.guess(&sides.lhs);
                if let Expr::Variable(variable, ..) = &sides.lhs {
                    let here = self.scopes.len() - 1;
                    let plain = !operator.is_op_assignment();
                    for (depth, scope) in self.scopes.iter_mut().enumerate().rev() {
                        if let Some((_, guess)) = scope.iter_mut().rev().find(|(n, _)| n.as_str() == variable.1.as_str()) {
                            *guess = if plain && depth == here { value } else { Guess::UNKNOWN };
                            break;
                        }
                    }
                }
            }
            Stmt::If(flow, _) => {
                self.guess(&flow.expr);
                self.block(flow.body.statements());
                self.block(flow.branch.statements());
            }
            Stmt::Switch(x, _) => {
                let (value, cases) = &**x;
                self.guess(value);
                for case in &cases.expressions {
                    self.guess(&case.lhs);
                    self.guess(&case.rhs);
                }
            }
            Stmt::While(flow, _) | Stmt::Do(flow, ..) => {
                self.guess(&flow.expr);
                self.block(flow.body.statements());
            }
            Stmt::For(x, _) => {
                let (item, counter, flow) = &**x;
                self.guess(&flow.expr);
                self.scopes.push(Vec::new());
                self.define(&item.name, Guess::UNKNOWN);
                if let Some(counter) = counter {
                    self.define(&counter.name, Guess::of(Kind::Number));
                }
                self.block(flow.body.statements());
                self.scopes.pop();
            }
            Stmt::FnCall(call, position) => {
                self.call(call, *position, None);
            }
            Stmt::Block(block) => self.block(block.statements()),
            Stmt::TryCatch(flow, _) => {
                self.block(flow.body.statements());
                self.scopes.push(Vec::new());
                if let Expr::Variable(caught, ..) = &flow.expr {
                    self.define(&caught.1, Guess::UNKNOWN);
                }
                self.block(flow.branch.statements());
                self.scopes.pop();
            }
            Stmt::Expr(value) => {
                self.guess(value);
            }
            Stmt::BreakLoop(Some(value), ..) | Stmt::Return(Some(value), ..) => {
                self.guess(value);
            }
            Stmt::Import(x, position) => {
                let (path, alias) = &**x;
                let guess = self.guess(path);
                let functions = guess.text().map(str::to_owned).and_then(|path| self.import(&path, *position));
                if !alias.name.is_empty() {
                    self.aliases.push((alias.name.to_string(), functions));
                }
            }
            _ => {}
        }
    }

    fn import(&mut self, path: &str, position: Position) -> Option<Vec<(String, usize)>> {
        match locate(&self.known.folder, path) {
            Ok(file) => Some(check_file(&file, self.known, self.seen, self.problems)),
            Err(message) => {
                self.problem(position, format!("the module \"{path}\" cannot be imported: {message}"), None);
                None
            }
        }
    }

    fn guess(&mut self, expression: &Expr) -> Guess {
        match expression {
            Expr::BoolConstant(..) | Expr::And(..) | Expr::Or(..) => {
                if let Expr::And(parts, _) | Expr::Or(parts, _) = expression {
                    parts.iter().for_each(|p| drop(self.guess(p)));
                }
                Guess::of(Kind::Truth)
            }
            Expr::IntegerConstant(..) | Expr::FloatConstant(..) => Guess::of(Kind::Number),
            Expr::StringConstant(text, _) => Guess { kind: Some(Kind::Text), facts: Facts::Text(text.to_string()) },
            Expr::InterpolatedString(parts, _) => {
                parts.iter().for_each(|p| drop(self.guess(p)));
                Guess::of(Kind::Text)
            }
            Expr::Array(items, _) => {
                items.iter().for_each(|i| drop(self.guess(i)));
                Guess::of(Kind::Other)
            }
            Expr::Map(x, _) => {
                let entries = x.0.iter().map(|(key, v)| (key.name.to_string(), self.guess(v), key.pos)).collect();
                Guess { kind: Some(Kind::Map), facts: Facts::Map(entries) }
            }
            Expr::DynamicConstant(value, _) => Guess::of(Kind::of(value)),
            Expr::CharConstant(..) | Expr::Unit(_) => Guess::of(Kind::Other),
            Expr::Variable(x, _, position) => {
                if x.2.is_empty() {
                    self.variable(&x.1, *position)
                } else {
                    Guess::UNKNOWN
                }
            }
            Expr::FnCall(call, position) => self.call(call, *position, None),
            Expr::Dot(sides, ..) => {
                let base = self.guess(&sides.lhs);
                self.chain(&base, &sides.rhs)
            }
            Expr::Index(sides, ..) => {
                self.guess(&sides.lhs);
                self.guess(&sides.rhs);
                Guess::UNKNOWN
            }
            Expr::Coalesce(parts, _) => {
                parts.iter().for_each(|p| drop(self.guess(p)));
                Guess::UNKNOWN
            }
            Expr::Stmt(block) => {
                self.block(block.statements());
                Guess::UNKNOWN
            }
            _ => Guess::UNKNOWN,
        }
    }

    fn variable(&mut self, name: &str, position: Position) -> Guess {
        if name == SCENE {
            return Guess::of(Kind::Scene);
        }
        let names: Vec<String> = self.scopes.iter().flatten().map(|(n, _)| n.clone()).chain([SCENE.to_owned()]).collect();
        if let Some((_, guess)) = self.scopes.iter().flatten().rev().find(|(n, _)| n == name) {
            return guess.clone();
        }
        let hint = did_you_mean(name, names.iter().map(String::as_str));
        self.problem(position, format!("'{name}' is not defined"), hint);
        Guess::UNKNOWN
    }

    /// What stands behind the dot, for what stands before it.
    fn chain(&mut self, base: &Guess, rest: &Expr) -> Guess {
        match rest {
            Expr::Property(x, position) => self.property(base, &x.2, *position),
            Expr::MethodCall(call, position) => self.call(call, *position, Some(base)),
            Expr::Dot(sides, ..) => {
                let next = self.chain(base, &sides.lhs);
                self.chain(&next, &sides.rhs)
            }
            Expr::Index(sides, ..) => {
                self.chain(base, &sides.lhs);
                self.guess(&sides.rhs);
                Guess::UNKNOWN
            }
            other => self.guess(other),
        }
    }

    fn property(&mut self, base: &Guess, name: &str, position: Position) -> Guess {
        let known: &[(&str, Option<Kind>)] = match base.kind {
            Some(Kind::Object) => &[("name", Some(Kind::Text)), ("position", None), ("version", Some(Kind::Text))],
            Some(Kind::Angle) => &[("deg", Some(Kind::Number)), ("rad", Some(Kind::Number))],
            Some(Kind::Length) => &[("m", Some(Kind::Number)), ("cm", Some(Kind::Number)), ("mm", Some(Kind::Number))],
            Some(Kind::Scene) => &[],
            _ => return Guess::UNKNOWN,
        };
        match known.iter().find(|(n, _)| *n == name) {
            Some((_, kind)) => Guess { kind: *kind, facts: Facts::None },
            None => {
                let what = base.kind.map_or("this", Kind::words);
                let hint = hint_among(name, "it has", known.iter().map(|(n, _)| *n));
                self.problem(position, format!("{what} has no property '{name}'"), Some(hint));
                Guess::UNKNOWN
            }
        }
    }

    fn call(&mut self, call: &FnCallExpr, position: Position, base: Option<&Guess>) -> Guess {
        let mut arguments: Vec<(Guess, Position)> = base.map(|b| (b.clone(), position)).into_iter().collect();
        for argument in &call.args {
            let guess = self.guess(argument);
            arguments.push((guess, argument.start_position()));
        }
        if let Some(operator) = &call.op_token {
            return operation(operator, &arguments);
        }
        let name = call.name.as_str();
        if !call.namespace.is_empty() {
            self.qualified(call, arguments.len(), position);
            return Guess::UNKNOWN;
        }
        if self.functions.iter().any(|(n, arity)| n == name && *arity == arguments.len()) {
            return Guess::UNKNOWN;
        }
        if self.known.skills.get(name).is_some() {
            // Arrays and texts have methods of such names too, told apart by what is acted on.
            let method = self.known.functions.iter().any(|(n, arity)| n == name && *arity == arguments.len());
            match arguments.first().map(|(guess, _)| guess.kind) {
                Some(None) if method => return Guess::UNKNOWN,
                Some(Some(kind)) if method && kind != Kind::Object => return Guess::UNKNOWN,
                _ => return self.skill(name, &arguments, position),
            }
        }
        if base.is_some_and(|b| b.kind == Some(Kind::Scene)) {
            match name {
                "expect" => return self.expect(name, &arguments[1..], position),
                "unknown" => {
                    self.expect(name, &arguments[1..], position);
                    return Guess::of(Kind::Other);
                }
                "learn" => return self.learn(&arguments[1..], position),
                _ => {}
            }
        }
        if base.is_some_and(|b| b.kind == Some(Kind::Scene)) && name == "robot" {
            self.model_named(arguments.get(1));
        }
        if let Some(guess) = self.ours(name, &arguments, position) {
            return guess;
        }
        self.exists(name, arguments.len(), base, position);
        Guess::UNKNOWN
    }

    /// Is there such a function at all?
    fn exists(&mut self, name: &str, count: usize, base: Option<&Guess>, position: Position) {
        let known = self.known;
        let arities: Vec<usize> = known.functions.iter().chain(&self.functions).filter(|(n, _)| n == name).map(|(_, a)| *a).collect();
        // `call` and `curry` take any number; a map or a variable may hold a function.
        let may_hold = base.is_some_and(|b| matches!(b.kind, None | Some(Kind::Map)));
        if arities.contains(&count) || matches!(name, "call" | "curry") || self.scopes.iter().flatten().any(|(n, _)| n == name) {
            return;
        }
        if !arities.is_empty() {
            if !may_hold {
                let hidden = usize::from(base.is_some());
                let mut allowed: Vec<String> = arities.iter().filter(|a| **a >= hidden).map(|a| (a - hidden).to_string()).collect();
                allowed.dedup();
                let hint = (!allowed.is_empty()).then(|| format!("it takes {}", allowed.join(" or ")));
                self.problem(position, format!("'{name}' does not take {} arguments", count - hidden), hint);
            }
            return;
        }
        if let Some(broken) = known.skills.broken.iter().find(|b| b.name.as_deref() == Some(name)) {
            self.problem(position, format!("the skill '{name}' was found but cannot be used: {broken}"), None);
            return;
        }
        let mut names: Vec<&str> = known.skills.loaded.iter().map(|s| s.manifest.name.as_str()).collect();
        let skills = match names.is_empty() {
            true => "no skills were found; build them with 'cargo build --release', or give their folder with --skills DIR".to_owned(),
            false => format!("skills: {}", names.join(", ")),
        };
        names.extend(
            known
                .functions
                .iter()
                .chain(&self.functions)
                .map(|(n, _)| n.as_str())
                .filter(|n| n.starts_with(|c: char| c.is_ascii_alphabetic())),
        );
        let near = did_you_mean(name, names);
        if may_hold && near.is_none() {
            return;
        }
        self.problem(position, format!("there is no function or skill '{name}'"), Some(near.unwrap_or(skills)));
    }

    fn qualified(&mut self, call: &FnCallExpr, count: usize, position: Position) {
        let alias = call.namespace.root();
        if call.namespace.path.len() != 1 || alias == "global" {
            return;
        }
        match self.aliases.iter().rev().find(|(a, _)| a == alias).cloned() {
            None => {
                let hint = hint_among(alias, "imported modules", self.aliases.iter().map(|(a, _)| a.as_str()));
                self.problem(call.namespace.position(), format!("no module is imported as '{alias}'"), Some(hint));
            }
            Some((_, None)) => {}
            Some((_, Some(functions))) => {
                let name = call.name.as_str();
                if !functions.iter().any(|(n, _)| n == name) {
                    let hint = hint_among(name, "its functions", functions.iter().map(|(n, _)| n.as_str()));
                    self.problem(position, format!("the module '{alias}' has no function '{name}'"), Some(hint));
                } else if !functions.iter().any(|(n, arity)| n == name && *arity == count) {
                    self.problem(position, format!("'{alias}::{name}' does not take {count} arguments"), None);
                }
            }
        }
    }

    fn skill(&mut self, name: &str, arguments: &[(Guess, Position)], position: Position) -> Guess {
        let Some(skill) = self.known.skills.get(name) else { return Guess::UNKNOWN };
        let mut flat: Vec<(Given, Position)> = arguments.iter().map(|(g, p)| (Given { name: None, kind: g.kind }, *p)).collect();
        match arguments.last() {
            Some((Guess { facts: Facts::Map(entries), .. }, _)) => {
                flat.pop();
                flat.extend(entries.iter().map(|(key, g, p)| (Given { name: Some(key.clone()), kind: g.kind }, *p)));
            }
            // A map or something unknown at the end may hold any named arguments.
            Some((guess, _)) if matches!(guess.kind, None | Some(Kind::Map)) => return Guess::of(Kind::Map),
            _ => {}
        }
        let given: Vec<Given> = flat.iter().map(|(g, _)| g.clone()).collect();
        if let Err(misfit) = bind(&skill.manifest, &given) {
            let at = misfit.argument.and_then(|i| flat.get(i)).map_or(position, |(_, p)| *p);
            self.problem(at, misfit.message, misfit.hint);
        }
        Guess::of(Kind::Map)
    }

    /// The functions of `value.rs`.
    fn ours(&mut self, name: &str, arguments: &[(Guess, Position)], position: Position) -> Option<Guess> {
        match name {
            "gap" if matches!(arguments.len(), 2 | 3) => return Some(self.gap(arguments)),
            "last_run" if arguments.is_empty() => return Some(Guess::of(Kind::Run)),
            _ => {}
        }
        let units = |units: &[(&str, f64)]| units.iter().any(|(n, _)| *n == name);
        let (kind, wanted, hint): (Kind, Kind, &str) = match name {
            _ if units(ANGLE_UNITS) => (Kind::Angle, Kind::Number, "it makes an angle of a bare number"),
            _ if units(LENGTH_UNITS) => (Kind::Length, Kind::Number, "it makes a length of a bare number"),
            "at" => (Kind::At, Kind::Length, "write at(cm(40), cm(10))"),
            "facing" => (Kind::Facing, Kind::Angle, "write facing(deg(90))"),
            "inside" => (Kind::Inside, Kind::Object, "write inside(object) or inside(object, \"region\")"),
            "joint" if arguments.first().is_some_and(|(g, _)| g.kind == Some(Kind::Object)) => {
                return Some(self.joint(arguments));
            }
            _ => return None,
        };
        let counts = match name {
            "at" => 2..=3,
            "inside" => 1..=2,
            _ => 1..=1,
        };
        if !counts.contains(&arguments.len()) {
            self.problem(position, format!("'{name}' does not take {} arguments", arguments.len()), Some(hint.to_owned()));
            return Some(Guess::of(kind));
        }
        for (i, (guess, at)) in arguments.iter().enumerate() {
            let wanted = if name == "inside" && i == 1 { Kind::Text } else { wanted };
            if let Some(is) = guess.kind.filter(|k| *k != wanted) {
                self.problem(*at, format!("{name}(...) needs {}, and is given {}", wanted.words(), is.words()), Some(hint.to_owned()));
            }
        }
        if let ("inside", [(Guess { facts: Facts::Object(model), .. }, _), rest @ ..]) = (name, arguments) {
            self.region(model, rest.first(), position);
        }
        Some(Guess::of(kind))
    }

    /// Which object, which runs, and what stands in the map.
    fn gap(&mut self, arguments: &[(Guess, Position)]) -> Guess {
        let wanted = [
            ("an object first", &[Kind::Object][..]),
            ("recorded runs", &[Kind::Run, Kind::Other]),
            ("its options as a map", &[Kind::Map]),
        ];
        for ((guess, at), (what, kinds)) in arguments.iter().zip(wanted) {
            if let Some(is) = guess.kind.filter(|k| !kinds.contains(k)) {
                self.problem(*at, format!("gap(...) needs {what}, and is given {}", is.words()), Some(GAP_HINT.to_owned()));
            }
        }
        if let Some((Guess { facts: Facts::Map(entries), .. }, _)) = arguments.get(2) {
            for (name, value, at) in entries {
                match GAP_OPTIONS.iter().find(|(n, _)| n == name) {
                    None => {
                        let hint = hint_among(name, "its options", GAP_OPTIONS.map(|(n, _)| n));
                        self.problem(*at, format!("gap has no option '{name}'"), Some(hint));
                    }
                    Some((_, wanted)) => {
                        if let Some((is, wanted)) = value.kind.zip(*wanted).filter(|(is, wanted)| is != wanted) {
                            self.problem(*at, format!("gap: '{name}' is {}, and must be {}", is.words(), wanted.words()), None);
                        }
                    }
                }
            }
        }
        Guess::of(Kind::Map)
    }

    fn region(&mut self, model: &ObjectModel, named: Option<&(Guess, Position)>, position: Position) {
        let regions = &model.document.regions;
        if regions.is_empty() {
            self.problem(position, format!("the model '{}' has no regions that things can be put into", model.name), None);
        } else if let Some((Some(name), at)) = named.map(|(g, p)| (g.text(), *p))
            && !regions.iter().any(|r| r.name == name)
        {
            let hint = hint_among(name, "its regions", regions.iter().map(|r| r.name.as_str()));
            self.problem(at, format!("the model '{}' has no region '{name}'", model.name), Some(hint));
        }
    }

    fn joint(&mut self, arguments: &[(Guess, Position)]) -> Guess {
        let [(object, _), (name, at)] = arguments else { return Guess::of(Kind::Object) };
        let (Facts::Object(model), Some(name)) = (&object.facts, name.text()) else { return Guess::of(Kind::Object) };
        self.joint_of(model, name, *at);
        Guess { kind: Some(Kind::Object), facts: Facts::Object(model.clone()) }
    }

    /// A moving joint of a model by name.
    fn joint_of(&mut self, model: &ObjectModel, name: &str, position: Position) -> Option<usize> {
        let found = model.moving_joints().find(|j| model.joints[*j].name == name);
        if found.is_none() {
            let hint = hint_among(name, "its joints", model.moving_joints().map(|j| model.joints[j].name.as_str()).collect::<Vec<_>>());
            self.problem(position, format!("the model '{}' has no moving joint '{name}'", model.name), Some(hint));
        }
        found
    }

    /// A model that is named by a plain text.
    fn model_named(&mut self, argument: Option<&(Guess, Position)>) -> Option<Arc<ObjectModel>> {
        let (guess, position) = argument?;
        let name = guess.text()?;
        let names = self.known.models.names();
        if !names.iter().any(|n| n == name) {
            let hint = hint_among(name, "models", names.iter().map(String::as_str));
            self.problem(*position, format!("the library has no model '{name}'"), Some(hint));
            return None;
        }
        match self.known.models.model(name) {
            Ok(model) => Some(model),
            Err(message) => {
                self.problem(*position, format!("the model '{name}' cannot be used: {message}"), None);
                None
            }
        }
    }

    fn expect(&mut self, function: &str, arguments: &[(Guess, Position)], position: Position) -> Guess {
        let model = self.model_named(arguments.first());
        match arguments.first() {
            Some((guess, at)) if guess.kind.is_some_and(|k| k != Kind::Text) => {
                self.problem(*at, format!("scene.{function}(...) needs the model's name first"), Some(EXPECT_HINT.to_owned()));
            }
            None => self.problem(position, format!("scene.{function}(...) needs the model's name"), Some(EXPECT_HINT.to_owned())),
            _ => {}
        }
        let mut name = arguments.first().and_then(|(g, _)| g.text()).map(str::to_owned);
        let mut places = 0;
        let mut certain = true;
        for (guess, at) in arguments.get(1..).unwrap_or_default() {
            match guess.kind {
                Some(Kind::At | Kind::Inside) => places += 1,
                Some(Kind::Facing) => {}
                Some(Kind::Text) => name = guess.text().map(str::to_owned),
                Some(Kind::Map) => {
                    if let (Facts::Map(entries), Some(model)) = (&guess.facts, &model) {
                        for (joint, value, at) in entries {
                            self.start(model, joint, value, *at);
                        }
                    }
                }
                None => certain = false,
                Some(other) => {
                    self.problem(*at, format!("scene.{function}(...) cannot use {}", other.words()), Some(EXPECT_HINT.to_owned()));
                }
            }
        }
        if certain && places != 1 {
            let message = if places == 0 { "it is not said where it is" } else { "it is said to be at two places" };
            self.problem(position, format!("scene.{function}(...): {message}"), Some(EXPECT_HINT.to_owned()));
        }
        // Only at the top can the same line not run twice.
        if let (Some(name), true) = (name, self.scopes.len() == 1) {
            if self.declared.contains(&name) {
                let hint = format!("name one of them: scene.{function}(\"{name}\", ..., \"second_{name}\")");
                self.problem(position, format!("there is already a '{name}' in the scene"), Some(hint));
            }
            self.declared.push(name);
        }
        let facts = model.map_or(Facts::None, Facts::Object);
        Guess { kind: Some(Kind::Object), facts }
    }

    /// A thing that nobody has told of, by the name that it gets.
    fn learn(&mut self, arguments: &[(Guess, Position)], position: Position) -> Guess {
        match arguments {
            [(guess, at)] => match (guess.kind, guess.text().map(str::to_owned)) {
                (Some(Kind::Text), Some(name)) if self.scopes.len() == 1 => {
                    if self.declared.contains(&name) {
                        let message = format!("there is already a '{name}' in the scene");
                        self.problem(*at, message, Some("give what is learned another name".to_owned()));
                    }
                    self.declared.push(name);
                }
                (None | Some(Kind::Text), _) => {}
                (Some(other), _) => {
                    self.problem(
                        *at,
                        format!("scene.learn(...) needs a name, and is given {}", other.words()),
                        Some(LEARN_HINT.to_owned()),
                    );
                }
            },
            _ => {
                self.problem(position, "scene.learn(...) takes the name that the thing gets, and nothing else", Some(LEARN_HINT.to_owned()))
            }
        }
        Guess::of(Kind::Object)
    }

    /// The position of a joint at the start.
    fn start(&mut self, model: &ObjectModel, name: &str, value: &Guess, position: Position) {
        let Some(joint) = self.joint_of(model, name, position) else { return };
        let wanted = if model.joints[joint].kind == JointKind::Prismatic { Kind::Length } else { Kind::Angle };
        if let Some(is) = value.kind.filter(|k| *k != wanted) {
            self.problem(position, format!("the joint '{name}' needs {}, and is given {}", wanted.words(), is.words()), None);
        }
    }
}

/// What an operator makes of quantities and numbers.
fn operation(operator: &Token, arguments: &[(Guess, Position)]) -> Guess {
    let kinds: Vec<Option<Kind>> = arguments.iter().map(|(g, _)| g.kind).collect();
    let quantity = |k: Kind| matches!(k, Kind::Angle | Kind::Length);
    let kind = match (operator, kinds.as_slice()) {
        (Token::Minus | Token::UnaryMinus | Token::Plus | Token::UnaryPlus, [Some(k)]) => Some(*k),
        (Token::Minus | Token::Plus, [Some(a), Some(b)]) if a == b && (quantity(*a) || *a == Kind::Number) => Some(*a),
        (Token::Multiply, [Some(Kind::Number), Some(k)] | [Some(k), Some(Kind::Number)]) if quantity(*k) || *k == Kind::Number => Some(*k),
        (Token::Divide, [Some(k), Some(Kind::Number)]) if quantity(*k) || *k == Kind::Number => Some(*k),
        (Token::Divide, [Some(a), Some(b)]) if a == b && quantity(*a) => Some(Kind::Number),
        (
            Token::LessThan
            | Token::GreaterThan
            | Token::LessThanEqualsTo
            | Token::GreaterThanEqualsTo
            | Token::EqualsTo
            | Token::NotEqualsTo
            | Token::Bang,
            _,
        ) => Some(Kind::Truth),
        _ => None,
    };
    Guess { kind, facts: Facts::None }
}
