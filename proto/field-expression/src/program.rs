//! From a tree to operations on scalars, each of which is done once however often its value is used.

use super::parse::{Binary, Syntax};
use std::collections::{BTreeSet, HashMap};

/// Place of an operation in a program.
pub(super) type Id = usize;

/// The most operations: an expression of a thousand bytes can name more.
const MOST_OPS: usize = 1000;
/// The most computed values that derivatives are taken of: each is kept for all points of the grid.
const MOST_KEPT: usize = 8;

/// One operand and what comes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Unary {
    Negate,
    Sqrt,
    Abs,
    Exp,
    Log,
    Log10,
}

/// An operation on scalars; those that it uses stand before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Op {
    /// The bits of a number.
    Constant(u64),
    Field(usize),
    Unary(Unary, Id),
    Binary(Binary, Id, Id),
    /// Along an axis.
    Derivative(usize, Id),
    /// The middle eigenvalue of S^2 + R^2, where S and R are the symmetric and the antisymmetric part of the velocity's gradient
    /// (Jeong and Hussain, On the identification of a vortex, 1995); entry `3 i + j` is the derivative of component i along axis j.
    Lambda2([Id; 9]),
}

impl Op {
    /// The operations that it uses.
    pub(super) fn inputs(&self) -> impl Iterator<Item = Id> {
        let (pair, nine): ([Option<Id>; 2], &[Id]) = match self {
            Self::Constant(_) | Self::Field(_) => ([None, None], &[]),
            Self::Unary(_, a) | Self::Derivative(_, a) => ([Some(*a), None], &[]),
            Self::Binary(_, a, b) => ([Some(*a), Some(*b)], &[]),
            Self::Lambda2(jacobian) => ([None, None], jacobian),
        };
        pair.into_iter().flatten().chain(nine.iter().copied())
    }
}

/// Operations in an order in which they can be done.
#[derive(Debug, Clone)]
pub(super) struct Program {
    pub ops: Vec<Op>,
    /// The one that is asked for.
    pub root: Id,
}

/// What an expression gives.
#[derive(Debug, Clone, Copy)]
enum Value {
    Scalar(Id),
    Vector([Id; 3]),
}

impl Value {
    fn scalar(self, what: &str) -> Result<Id, String> {
        match self {
            Self::Scalar(id) => Ok(id),
            Self::Vector(_) => {
                Err(format!("{what} is a vector where a scalar is needed; take its magnitude, or .x, .y, .z"))
            }
        }
    }

    fn vector(self, what: &str) -> Result<[Id; 3], String> {
        match self {
            Self::Vector(ids) => Ok(ids),
            Self::Scalar(_) => Err(format!(
                "{what} is a scalar where a vector is needed: fields NAME.x, NAME.y, NAME.z, or vector(a, b, c)"
            )),
        }
    }
}

impl Program {
    /// One field, unchanged.
    pub(super) fn of_field(field: usize) -> Self {
        Self { ops: vec![Op::Field(field)], root: 0 }
    }

    /// The operations of `syntax` on fields of these names.
    pub(super) fn new(syntax: &Syntax, names: &[&str]) -> Result<Self, String> {
        let mut builder = Builder { names, ops: Vec::new(), known: HashMap::new() };
        let root = builder.value(syntax)?.scalar("it")?;
        if builder.ops.len() > MOST_OPS {
            return Err(format!("it takes {} operations; {MOST_OPS} is the most", builder.ops.len()));
        }
        let program = Self { ops: builder.ops, root };
        let kept = program.kept().len();
        if kept > MOST_KEPT {
            return Err(format!("it takes derivatives of {kept} computed values; {MOST_KEPT} is the most"));
        }
        Ok(program)
    }

    /// The computed values that derivatives are taken of, in an order in which they can be computed.
    pub(super) fn kept(&self) -> BTreeSet<Id> {
        let source = |op: &Op| if let Op::Derivative(_, of) = op { Some(*of) } else { None };
        self.ops.iter().filter_map(source).filter(|&of| !matches!(self.ops[of], Op::Field(_))).collect()
    }

    /// How many points beside its own a value of the root depends on.
    pub(super) fn reach(&self) -> usize {
        let mut reach = vec![0; self.ops.len()];
        for (id, op) in self.ops.iter().enumerate() {
            let of_operands = op.inputs().map(|a| reach[a]).max().unwrap_or(0);
            reach[id] = of_operands + usize::from(matches!(op, Op::Derivative(..)));
        }
        reach[self.root]
    }
}

struct Builder<'a> {
    names: &'a [&'a str],
    ops: Vec<Op>,
    known: HashMap<Op, Id>,
}

impl Builder<'_> {
    fn op(&mut self, op: Op) -> Id {
        if let Some(&id) = self.known.get(&op) {
            return id;
        }
        self.ops.push(op);
        self.known.insert(op, self.ops.len() - 1);
        self.ops.len() - 1
    }

    fn constant(&mut self, number: f64) -> Id {
        self.op(Op::Constant(number.to_bits()))
    }

    fn binary(&mut self, operator: Binary, a: Id, b: Id) -> Id {
        self.op(Op::Binary(operator, a, b))
    }

    fn derivative(&mut self, axis: usize, of: Id) -> Id {
        match self.ops[of] {
            Op::Constant(_) => self.constant(0.0),
            _ => self.op(Op::Derivative(axis, of)),
        }
    }

    fn sum(&mut self, terms: &[Id]) -> Id {
        let Some((&first, rest)) = terms.split_first() else { return self.constant(0.0) };
        rest.iter().fold(first, |sum, &term| self.binary(Binary::Add, sum, term))
    }

    fn dot(&mut self, a: [Id; 3], b: [Id; 3]) -> Id {
        let products = [0, 1, 2].map(|n| self.binary(Binary::Multiply, a[n], b[n]));
        self.sum(&products)
    }

    /// Entry `3 i + j`: the derivative of component i along axis j.
    fn jacobian(&mut self, v: [Id; 3]) -> [Id; 9] {
        std::array::from_fn(|n| self.derivative(n % 3, v[n / 3]))
    }

    fn field(&mut self, name: &str) -> Result<Value, String> {
        let place = |name: &str| self.names.iter().position(|known| *known == name);
        if let Some(field) = place(name) {
            return Ok(Value::Scalar(self.op(Op::Field(field))));
        }
        match ["x", "y", "z"].map(|axis| place(&format!("{name}.{axis}"))) {
            [Some(x), Some(y), Some(z)] => Ok(Value::Vector([x, y, z].map(|field| self.op(Op::Field(field))))),
            _ => Err(format!("there is no field \"{name}\"")),
        }
    }

    fn value(&mut self, syntax: &Syntax) -> Result<Value, String> {
        Ok(match syntax {
            Syntax::Number(number) => Value::Scalar(self.constant(*number)),
            Syntax::Name(name) => self.field(name)?,
            Syntax::Component(of, axis) => {
                Value::Scalar(self.value(of)?.vector("what .x, .y or .z is taken of")?[*axis])
            }
            Syntax::Negate(of) => match self.value(of)? {
                Value::Scalar(a) => Value::Scalar(self.op(Op::Unary(Unary::Negate, a))),
                Value::Vector(v) => Value::Vector(v.map(|a| self.op(Op::Unary(Unary::Negate, a)))),
            },
            Syntax::Binary(operator, a, b) => {
                let (a, b) = (self.value(a)?, self.value(b)?);
                self.arithmetic(*operator, a, b)?
            }
            Syntax::Call(name, arguments) => {
                let values = arguments.iter().map(|argument| self.value(argument)).collect::<Result<Vec<_>, _>>()?;
                self.call(name, &values)?
            }
        })
    }

    fn arithmetic(&mut self, operator: Binary, a: Value, b: Value) -> Result<Value, String> {
        use Value::{Scalar, Vector};
        match (operator, a, b) {
            (_, Scalar(a), Scalar(b)) => Ok(Scalar(self.binary(operator, a, b))),
            (Binary::Add | Binary::Subtract, Vector(a), Vector(b)) => {
                Ok(Vector([0, 1, 2].map(|n| self.binary(operator, a[n], b[n]))))
            }
            (Binary::Multiply | Binary::Divide, Vector(v), Scalar(s)) => {
                Ok(Vector(v.map(|a| self.binary(operator, a, s))))
            }
            (Binary::Multiply, Scalar(s), Vector(v)) => Ok(Vector(v.map(|a| self.binary(operator, s, a)))),
            (Binary::Multiply, Vector(_), Vector(_)) => {
                Err("two vectors are multiplied; write dot(a, b) or cross(a, b)".to_owned())
            }
            _ => Err("a vector and a scalar cannot be joined so".to_owned()),
        }
    }

    fn call(&mut self, name: &str, arguments: &[Value]) -> Result<Value, String> {
        let unary = [
            ("sqrt", Unary::Sqrt),
            ("abs", Unary::Abs),
            ("exp", Unary::Exp),
            ("log", Unary::Log),
            ("log10", Unary::Log10),
        ];
        let what = format!("the argument of {name}");
        if let (Some((_, operator)), [a]) = (unary.iter().find(|(known, _)| *known == name), arguments) {
            let a = a.scalar(&what)?;
            return Ok(Value::Scalar(self.op(Op::Unary(*operator, a))));
        }
        Ok(match (name, arguments) {
            ("min" | "max", [a, b]) => {
                let operator = if name == "min" { Binary::Min } else { Binary::Max };
                Value::Scalar(self.binary(operator, a.scalar(&what)?, b.scalar(&what)?))
            }
            ("vector", [a, b, c]) => Value::Vector([a.scalar(&what)?, b.scalar(&what)?, c.scalar(&what)?]),
            ("magnitude", [v]) => {
                let v = v.vector(&what)?;
                let square = self.dot(v, v);
                Value::Scalar(self.op(Op::Unary(Unary::Sqrt, square)))
            }
            ("dot", [a, b]) => Value::Scalar(self.dot(a.vector(&what)?, b.vector(&what)?)),
            ("cross", [a, b]) => {
                let (a, b) = (a.vector(&what)?, b.vector(&what)?);
                Value::Vector([0, 1, 2].map(|n| {
                    let (i, j) = ((n + 1) % 3, (n + 2) % 3);
                    let (plus, minus) =
                        (self.binary(Binary::Multiply, a[i], b[j]), self.binary(Binary::Multiply, a[j], b[i]));
                    self.binary(Binary::Subtract, plus, minus)
                }))
            }
            ("gradient", [a]) => {
                let a = a.scalar(&what)?;
                Value::Vector([0, 1, 2].map(|axis| self.derivative(axis, a)))
            }
            ("divergence", [v]) => {
                let v = v.vector(&what)?;
                let terms = [0, 1, 2].map(|axis| self.derivative(axis, v[axis]));
                Value::Scalar(self.sum(&terms))
            }
            ("curl", [v]) => {
                let v = v.vector(&what)?;
                Value::Vector([0, 1, 2].map(|n| {
                    let (i, j) = ((n + 1) % 3, (n + 2) % 3);
                    let (plus, minus) = (self.derivative(i, v[j]), self.derivative(j, v[i]));
                    self.binary(Binary::Subtract, plus, minus)
                }))
            }
            ("lambda2", [v]) => {
                let jacobian = self.jacobian(v.vector(&what)?);
                Value::Scalar(self.op(Op::Lambda2(jacobian)))
            }
            // Half of |R|^2 - |S|^2, which is -1/2 sum J_ij J_ji (Hunt, Wray and Moin, 1988).
            ("q_criterion", [v]) => {
                let j = self.jacobian(v.vector(&what)?);
                let products: [Id; 9] =
                    std::array::from_fn(|n| self.binary(Binary::Multiply, j[n], j[3 * (n % 3) + n / 3]));
                let (sum, factor) = (self.sum(&products), self.constant(-0.5));
                Value::Scalar(self.binary(Binary::Multiply, factor, sum))
            }
            (_, arguments) => {
                let (count, known) = (counted(arguments.len()), super::FieldExpression::GRAMMAR);
                return Err(format!("{name} of {count} is not known. Understood are {known}"));
            }
        })
    }
}

fn counted(arguments: usize) -> String {
    if arguments == 1 { "one argument".to_owned() } else { format!("{arguments} arguments") }
}
