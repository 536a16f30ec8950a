//! Modules and types of the crates, read from their source: no two modules import each other, and no name has two meanings.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use syn::{Item, UseTree};

/// Name of a module within its crate, from the root.
type ModulePath = Vec<String>;

/// One source file.
struct SourceFile {
    items: Vec<Item>,
}

/// The modules of one crate.
struct CrateModules(BTreeMap<ModulePath, SourceFile>);

/// Crates of the product, tests aside.
const CRATES: [&str; 19] = [
    "proto/model",
    "proto/message",
    "proto/codec",
    "proto/rpc",
    "proto/field-expression",
    "proto/compute",
    "proto/raycast",
    "proto/vdi-render",
    "proto/client",
    "generator-node",
    "viz-node",
    "tuner",
    "deploy/cli",
    "deploy/lab",
    "deploy/report",
    "deploy/volume-io",
    "deploy/blast",
    "deploy/catalyst",
    "deploy/python/native",
];

/// Names that several crates give to their own part of one thing: the configuration and the arguments of each daemon, the levels
/// of the two kernels, and lanes of the SIMD levels.
const SHARED_NAMES: [&str; 12] = [
    "Config",
    "Arguments",
    "Backend",
    "GpuError",
    "GpuKernels",
    "Pipelines",
    "PictureBand",
    "PictureUniforms",
    "ViewUniforms",
    "PixelList",
    "RaySetup",
    "Gpu",
];

impl CrateModules {
    fn read(folder: &str, files: &[(std::path::PathBuf, String)]) -> Self {
        let source = Path::new(folder).join("src");
        let mut modules = BTreeMap::new();
        for (path, text) in files {
            let Ok(inside) = path.strip_prefix(&source) else { continue };
            let name = inside.with_extension("");
            let mut module: ModulePath = name.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
            // Stand-ins of builds without a GPU repeat what they stand in for.
            if module.iter().any(|part| part.starts_with("tests") || part.ends_with("absent")) {
                continue;
            }
            if module.last().is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str())) {
                let is_program = module.pop().unwrap() == "main" && source_has(files, &source, "lib.rs");
                if is_program {
                    continue;
                }
            }
            let items = syn::parse_file(text).unwrap_or_else(|e| panic!("{}: {e}", path.display())).items;
            modules.insert(module, SourceFile { items });
        }
        Self(modules)
    }

    /// The module that defines what `path`, written in module `from`, names.
    fn resolve(&self, from: &ModulePath, path: &[String], depth: usize) -> Option<ModulePath> {
        let (mut base, mut rest) = (from.clone(), path);
        match rest.first()?.as_str() {
            "crate" => (base, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|part| part == "super") {
                    base.pop();
                    rest = &rest[1..];
                }
            }
            first => drop(self.0.get(&[base.as_slice(), &[first.to_owned()]].concat())?),
        }
        while let Some(part) = rest.first() {
            let inner = [base.as_slice(), std::slice::from_ref(part)].concat();
            if !self.0.contains_key(&inner) {
                break;
            }
            (base, rest) = (inner, &rest[1..]);
        }
        let Some(name) = rest.first().filter(|name| *name != "self" && *name != "*") else { return Some(base) };
        let file = &self.0[&base];
        if depth < 8 && !file.defines(name) {
            // Exported again from where it is defined.
            let origin = file.imports().into_iter().find(|(_, path)| path.last() == Some(name));
            return origin.map_or(Some(base.clone()), |(_, path)| self.resolve(&base, &path, depth + 1));
        }
        Some(base)
    }

    /// For every module, those that it imports from.
    fn imports(&self) -> BTreeMap<&ModulePath, BTreeSet<ModulePath>> {
        let of = |(module, file): (_, &SourceFile)| {
            let private = file.imports().into_iter().filter(|(exported, _)| !exported);
            let others = private.filter_map(|(_, path)| self.resolve(module, &path, 0)).filter(|m| m != module);
            (module, others.collect())
        };
        self.0.iter().map(of).collect()
    }
}

fn source_has(files: &[(std::path::PathBuf, String)], source: &Path, name: &str) -> bool {
    files.iter().any(|(path, _)| *path == source.join(name))
}

impl SourceFile {
    fn defines(&self, name: &str) -> bool {
        self.items.iter().any(|item| match item {
            Item::Const(i) => i.ident == name,
            Item::Enum(i) => i.ident == name,
            Item::Fn(i) => i.sig.ident == name,
            Item::Static(i) => i.ident == name,
            Item::Struct(i) => i.ident == name,
            Item::Trait(i) => i.ident == name,
            Item::Type(i) => i.ident == name,
            Item::Union(i) => i.ident == name,
            _ => false,
        })
    }

    /// Paths of `use` items, and whether they are exported.
    fn imports(&self) -> Vec<(bool, Vec<String>)> {
        let mut all = Vec::new();
        for item in &self.items {
            if let Item::Use(import) = item {
                let mut paths = Vec::new();
                flatten(&import.tree, &mut Vec::new(), &mut paths);
                let exported = !matches!(import.vis, syn::Visibility::Inherited);
                all.extend(paths.into_iter().map(|path| (exported, path)));
            }
        }
        all
    }

    /// Names of the types it defines.
    fn types(&self) -> impl Iterator<Item = String> {
        self.items.iter().filter_map(|item| match item {
            Item::Enum(i) => Some(i.ident.to_string()),
            Item::Struct(i) => Some(i.ident.to_string()),
            Item::Trait(i) => Some(i.ident.to_string()),
            Item::Union(i) => Some(i.ident.to_string()),
            _ => None,
        })
    }
}

fn flatten(tree: &UseTree, prefix: &mut Vec<String>, paths: &mut Vec<Vec<String>>) {
    let mut whole = |prefix: &[String], last: String| paths.push([prefix, &[last]].concat());
    match tree {
        UseTree::Path(path) => {
            prefix.push(path.ident.to_string());
            flatten(&path.tree, prefix, paths);
            prefix.pop();
        }
        UseTree::Name(name) => whole(prefix, name.ident.to_string()),
        UseTree::Rename(rename) => whole(prefix, rename.ident.to_string()),
        UseTree::Glob(_) => whole(prefix, "*".to_owned()),
        UseTree::Group(group) => group.items.iter().for_each(|tree| flatten(tree, prefix, paths)),
    }
}

/// A way from `start` back to itself along `imports`.
fn cycle<'a>(imports: &'a BTreeMap<&ModulePath, BTreeSet<ModulePath>>, start: &'a ModulePath) -> Option<Vec<String>> {
    let (mut ways, mut seen) = (vec![vec![start]], BTreeSet::new());
    while let Some(way) = ways.pop() {
        for next in imports.get(way[way.len() - 1]).into_iter().flatten() {
            if next == start {
                return Some(way.iter().map(|module| module.join("::")).collect());
            }
            if seen.insert(next) {
                ways.push(way.iter().copied().chain([next]).collect());
            }
        }
    }
    None
}

#[test]
fn no_two_modules_import_each_other() {
    let (files, mut cycles) = (super::rust_files(), Vec::new());
    for folder in CRATES {
        let modules = CrateModules::read(folder, &files);
        assert!(!modules.0.is_empty(), "{folder}");
        let imports = modules.imports();
        cycles.extend(modules.0.keys().filter_map(|module| Some((folder, cycle(&imports, module)?))));
    }
    assert!(cycles.is_empty(), "modules import each other; move what both need to a third: {cycles:#?}");
}

#[test]
fn no_type_name_has_two_meanings() {
    let files = super::rust_files();
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for folder in CRATES {
        for (module, file) in CrateModules::read(folder, &files).0 {
            for name in file.types() {
                places.entry(name).or_default().push(format!("{folder}: {}", module.join("::")));
            }
        }
    }
    assert!(places.len() > 400, "{} types", places.len());
    places.retain(|name, places| places.len() > 1 && !SHARED_NAMES.contains(&name.as_str()));
    assert!(places.is_empty(), "names of several types: {places:#?}");
}
