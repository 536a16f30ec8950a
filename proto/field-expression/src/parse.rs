//! From text to a tree of operations.

/// The longest text.
const MOST_BYTES: usize = 1000;
/// The deepest nesting.
const MOST_DEPTH: usize = 64;

/// Two operands and what comes of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

/// An expression as it is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Syntax {
    Number(f64),
    Name(String),
    Call(String, Vec<Syntax>),
    /// Component 0, 1 or 2 of a vector.
    Component(Box<Syntax>, usize),
    Negate(Box<Syntax>),
    Binary(Binary, Box<Syntax>, Box<Syntax>),
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    /// A field's name in quotation marks: no function.
    Quoted(String),
    Sign(char),
}

/// The tree of `text`.
pub(super) fn parse(text: &str) -> Result<Syntax, String> {
    if text.len() > MOST_BYTES {
        return Err(format!("{} bytes are more than {MOST_BYTES}", text.len()));
    }
    let mut parser = ExpressionParser { tokens: tokens(text)?, next: 0, depth: 0 };
    let tree = parser.sum()?;
    match parser.tokens.get(parser.next) {
        None => Ok(tree),
        Some(token) => Err(format!("{} is not expected there", shown(token))),
    }
}

fn shown(token: &Token) -> String {
    match token {
        Token::Number(number) => format!("the number {number}"),
        Token::Name(name) | Token::Quoted(name) => format!("\"{name}\""),
        Token::Sign(sign) => format!("'{sign}'"),
    }
}

fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let letters: Vec<char> = text.chars().collect();
    let (mut tokens, mut at) = (Vec::new(), 0);
    let is_of_name = |c: char| c.is_alphanumeric() || c == '_' || c == '.' || c == ':';
    while let Some(&letter) = letters.get(at) {
        let starts_number =
            letter.is_ascii_digit() || letter == '.' && letters.get(at + 1).is_some_and(char::is_ascii_digit);
        if letter.is_whitespace() {
            at += 1;
        } else if letter == '"' {
            let end = (at + 1..letters.len()).find(|&n| letters[n] == '"').ok_or("a quotation mark is not closed")?;
            tokens.push(Token::Quoted(letters[at + 1..end].iter().collect()));
            at = end + 1;
        } else if starts_number {
            let mut end = at;
            while let Some(&c) = letters.get(end) {
                let is_exponents = matches!(c, '+' | '-') && matches!(letters[end - 1], 'e' | 'E');
                if !(c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E') || is_exponents) {
                    break;
                }
                end += 1;
            }
            let digits: String = letters[at..end].iter().collect();
            let number = digits.parse::<f64>().ok().filter(|number| number.is_finite());
            tokens.push(Token::Number(number.ok_or_else(|| format!("\"{digits}\" is no number"))?));
            at = end;
        } else if letter.is_alphabetic() || letter == '_' {
            let end = (at..letters.len()).find(|&n| !is_of_name(letters[n])).unwrap_or(letters.len());
            tokens.push(Token::Name(letters[at..end].iter().collect()));
            at = end;
        } else if "+-*/^(),.".contains(letter) {
            tokens.push(Token::Sign(letter));
            at += 1;
        } else {
            return Err(format!("'{letter}' has no meaning; write a name that has it in quotation marks"));
        }
    }
    Ok(tokens)
}

struct ExpressionParser {
    tokens: Vec<Token>,
    next: usize,
    depth: usize,
}

impl ExpressionParser {
    fn take(&mut self, sign: char) -> bool {
        let is_next = self.tokens.get(self.next) == Some(&Token::Sign(sign));
        self.next += usize::from(is_next);
        is_next
    }

    fn expect(&mut self, sign: char) -> Result<(), String> {
        if self.take(sign) {
            return Ok(());
        }
        let found = self.tokens.get(self.next).map_or_else(|| "it ends".to_owned(), |t| format!("{} stands", shown(t)));
        Err(format!("{found} where '{sign}' is expected"))
    }

    /// Operands joined by the signs of `operators`, from left to right.
    fn chain(
        &mut self,
        operators: [(char, Binary); 2],
        operand: fn(&mut Self) -> Result<Syntax, String>,
    ) -> Result<Syntax, String> {
        let mut left = operand(self)?;
        while let Some((_, operator)) = operators.into_iter().find(|(sign, _)| self.take(*sign)) {
            left = Syntax::Binary(operator, Box::new(left), Box::new(operand(self)?));
        }
        Ok(left)
    }

    fn sum(&mut self) -> Result<Syntax, String> {
        self.depth += 1;
        if self.depth > MOST_DEPTH {
            return Err(format!("it is nested more than {MOST_DEPTH} deep"));
        }
        let sum = self.chain([('+', Binary::Add), ('-', Binary::Subtract)], Self::product);
        self.depth -= 1;
        sum
    }

    fn product(&mut self) -> Result<Syntax, String> {
        self.chain([('*', Binary::Multiply), ('/', Binary::Divide)], Self::signed)
    }

    /// `-a^b` is `-(a^b)`, as in print.
    fn signed(&mut self) -> Result<Syntax, String> {
        let mut negative = false;
        loop {
            if self.take('-') {
                negative = !negative;
            } else if !self.take('+') {
                break;
            }
        }
        let power = self.power()?;
        Ok(if negative { Syntax::Negate(Box::new(power)) } else { power })
    }

    /// `a^b^c` is `a^(b^c)`.
    fn power(&mut self) -> Result<Syntax, String> {
        let base = self.component()?;
        if !self.take('^') {
            return Ok(base);
        }
        self.depth += 1;
        if self.depth > MOST_DEPTH {
            return Err(format!("it is nested more than {MOST_DEPTH} deep"));
        }
        let exponent = self.signed()?;
        self.depth -= 1;
        Ok(Syntax::Binary(Binary::Power, Box::new(base), Box::new(exponent)))
    }

    fn component(&mut self) -> Result<Syntax, String> {
        let mut value = self.value()?;
        while self.take('.') {
            let axis = match self.tokens.get(self.next) {
                Some(Token::Name(name)) => ["x", "y", "z"].iter().position(|axis| axis == name),
                _ => None,
            };
            value = Syntax::Component(Box::new(value), axis.ok_or("x, y or z is expected after '.'")?);
            self.next += 1;
        }
        Ok(value)
    }

    fn value(&mut self) -> Result<Syntax, String> {
        let token = self.tokens.get(self.next).cloned().ok_or("it ends where a field or a number is expected")?;
        self.next += 1;
        match token {
            Token::Number(number) => Ok(Syntax::Number(number)),
            Token::Quoted(name) => Ok(Syntax::Name(name)),
            Token::Name(name) if self.take('(') => {
                let mut arguments = vec![self.sum()?];
                while self.take(',') {
                    arguments.push(self.sum()?);
                }
                self.expect(')')?;
                Ok(Syntax::Call(name, arguments))
            }
            Token::Name(name) => Ok(Syntax::Name(name)),
            Token::Sign('(') => {
                let inner = self.sum()?;
                self.expect(')')?;
                Ok(inner)
            }
            sign @ Token::Sign(_) => Err(format!("{} stands where a field or a number is expected", shown(&sign))),
        }
    }
}
