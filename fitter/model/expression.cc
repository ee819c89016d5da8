#include "fitter/model/expression.h"

#include <ceres/jet.h>

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <type_traits>

namespace armtrue {
namespace {

using Op = Expression::Op;

// Deeper text is refused, so that hostile input cannot exhaust the stack of the recursive walks
// below.
constexpr int kMaximumDepth = 100;
constexpr std::size_t kMaximumLength = 20000;

struct Function {
  std::string_view name;
  Op op;
  int arity;
};

constexpr std::array<Function, 17> kFunctions{{{"sin", Op::kSin, 1},
                                               {"cos", Op::kCos, 1},
                                               {"tan", Op::kTan, 1},
                                               {"asin", Op::kAsin, 1},
                                               {"acos", Op::kAcos, 1},
                                               {"atan", Op::kAtan, 1},
                                               {"exp", Op::kExp, 1},
                                               {"log", Op::kLog, 1},
                                               {"sqrt", Op::kSqrt, 1},
                                               {"abs", Op::kAbs, 1},
                                               {"sign", Op::kSign, 1},
                                               {"tanh", Op::kTanh, 1},
                                               {"atan2", Op::kAtan2, 2},
                                               {"min", Op::kMin, 2},
                                               {"max", Op::kMax, 2},
                                               {"hat", Op::kHat, 4},
                                               {"pow", Op::kPower, 2}}};

std::string_view function_name(Op op) {
  for (const Function& f : kFunctions) {
    if (f.op == op) return f.name;
  }
  return {};
}

// A number, or a number with its slope: everything below is written once for both.
using Slope = ceres::Jet<double, 1>;
double number_of(double v) { return v; }
double number_of(const Slope& v) { return v.a; }

// hat(v, l, c, r). A missing side (l = c or r = c) is held constant, so that end nodes extrapolate
// flat.
template <typename T>
T hat(const T& v, const T& l, const T& c, const T& r) {
  if (v <= c) {
    if (l >= c) return T(1.0);
    return v <= l ? T(0.0) : (v - l) / (c - l);
  }
  if (r <= c) return T(1.0);
  return v >= r ? T(0.0) : (r - v) / (r - c);
}

// What is not a number stays so, here and in min and max, so that it is seen and refused.
double sign(double v) { return v > 0.0 ? 1.0 : (v < 0.0 ? -1.0 : 0.0 * v); }

template <typename T>
T evaluate_op(Op op, const T* a) {
  using std::abs, std::acos, std::asin, std::atan, std::atan2, std::cos, std::exp, std::log,
      std::pow, std::sin, std::sqrt, std::tan, std::tanh;
  switch (op) {
    case Op::kAdd:
      return a[0] + a[1];
    case Op::kSubtract:
      return a[0] - a[1];
    case Op::kMultiply:
      return a[0] * a[1];
    case Op::kDivide:
      return a[0] / a[1];
    case Op::kPower:
      return a[1] == T(2.0) ? a[0] * a[0] : pow(a[0], a[1]);
    case Op::kNegate:
      return -a[0];
    case Op::kSin:
      return sin(a[0]);
    case Op::kCos:
      return cos(a[0]);
    case Op::kTan:
      return tan(a[0]);
    case Op::kAsin:
      return asin(a[0]);
    case Op::kAcos:
      return acos(a[0]);
    case Op::kAtan:
      return atan(a[0]);
    case Op::kExp:
      return exp(a[0]);
    case Op::kLog:
      return log(a[0]);
    case Op::kSqrt:
      return sqrt(a[0]);
    case Op::kAbs:
      return abs(a[0]);
    case Op::kSign:
      return T(sign(number_of(a[0])));
    case Op::kTanh:
      return tanh(a[0]);
    case Op::kAtan2:
      return atan2(a[0], a[1]);
    case Op::kMin:
      return std::isnan(number_of(a[0])) || a[0] < a[1] ? a[0] : a[1];
    case Op::kMax:
      return std::isnan(number_of(a[0])) || a[0] > a[1] ? a[0] : a[1];
    case Op::kHat:
      return hat(a[0], a[1], a[2], a[3]);
    case Op::kNumber:
    case Op::kVariable:
      break;
  }
  return T(0.0);
}

}  // namespace

struct Expression::Node {
  Op op = Op::kNumber;
  double value = 0.0;
  std::string name;
  std::vector<Expression> arguments;
};

Op Expression::op() const { return node_->op; }
double Expression::value() const { return node_->value; }
const std::string& Expression::name() const { return node_->name; }
const std::vector<Expression>& Expression::arguments() const { return node_->arguments; }

Expression Expression::number(double value) {
  return Expression(std::make_shared<const Node>(Node{Op::kNumber, value, {}, {}}));
}

Expression Expression::variable(std::string name) {
  return Expression(std::make_shared<const Node>(Node{Op::kVariable, 0.0, std::move(name), {}}));
}

Expression Expression::apply(Op op, std::vector<Expression> arguments) {
  bool constant = true;
  for (const Expression& a : arguments) constant = constant && a.is_constant();
  if (constant) {
    std::array<double, 4> values{};
    for (std::size_t i = 0; i < arguments.size(); ++i) values[i] = arguments[i].value();
    const double folded = evaluate_op(op, values.data());
    // What is not finite is left standing, so that the error shows where it is evaluated and not as
    // a silent number.
    if (std::isfinite(folded)) return number(folded);
  }
  const auto is = [&](std::size_t i, double v) {
    return arguments[i].is_constant() && arguments[i].value() == v;
  };
  switch (op) {
    case Op::kAdd:
      if (is(0, 0.0)) return arguments[1];
      if (is(1, 0.0)) return arguments[0];
      break;
    case Op::kSubtract:
      if (is(1, 0.0)) return arguments[0];
      break;
    case Op::kMultiply:
      if (is(0, 0.0) || is(1, 0.0)) return number(0.0);
      if (is(0, 1.0)) return arguments[1];
      if (is(1, 1.0)) return arguments[0];
      break;
    case Op::kDivide:
    case Op::kPower:
      if (is(1, 1.0)) return arguments[0];
      break;
    default:
      break;
  }
  return Expression(std::make_shared<const Node>(Node{op, 0.0, {}, std::move(arguments)}));
}

Expression operator+(const Expression& a, const Expression& b) {
  return Expression::apply(Op::kAdd, {a, b});
}
Expression operator-(const Expression& a, const Expression& b) {
  return Expression::apply(Op::kSubtract, {a, b});
}
Expression operator*(const Expression& a, const Expression& b) {
  return Expression::apply(Op::kMultiply, {a, b});
}
Expression operator/(const Expression& a, const Expression& b) {
  return Expression::apply(Op::kDivide, {a, b});
}

// --- parsing
// ---------------------------------------------------------------------------------------------------------

namespace {

class Parser {
 public:
  explicit Parser(std::string_view text) : text_(text) {}

  Expression parse() {
    if (text_.size() > kMaximumLength) fail("an expression of at most 20000 characters");
    Expression result = sum(0);
    skip_space();
    if (at_ != text_.size()) fail("an operator or the end");
    return result;
  }

 private:
  [[noreturn]] void fail(const std::string& expected) const {
    std::string found =
        at_ < text_.size() ? "'" + std::string(text_.substr(at_, 12)) + "'" : "the end";
    throw ExpressionError("at character " + std::to_string(at_ + 1) + ": found " + found +
                          ", expected " + expected);
  }

  void skip_space() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t' || text_[at_] == '\n'))
      ++at_;
  }

  bool accept(std::string_view token) {
    skip_space();
    if (text_.substr(at_, token.size()) != token) return false;
    at_ += token.size();
    return true;
  }

  void enter(int depth) const {
    if (depth > kMaximumDepth) fail("at most 100 levels of nesting");
  }

  // A chain of operators nests as deep as it is long, so its length counts as depth.
  Expression sum(int depth) {
    enter(depth);
    Expression left = product(depth + 1);
    for (int chain = depth;; ++chain) {
      enter(chain - depth > 900 ? kMaximumDepth + 1 : depth);
      if (accept("+")) {
        left = left + product(depth + 1);
      } else if (accept("-")) {
        left = left - product(depth + 1);
      } else {
        return left;
      }
    }
  }

  Expression product(int depth) {
    Expression left = unary(depth + 1);
    for (int chain = depth;; ++chain) {
      enter(chain - depth > 900 ? kMaximumDepth + 1 : depth);
      skip_space();
      if (text_.substr(at_, 2) == "**") return left;
      if (accept("*")) {
        left = left * unary(depth + 1);
      } else if (accept("/")) {
        left = left / unary(depth + 1);
      } else {
        return left;
      }
    }
  }

  Expression unary(int depth) {
    enter(depth);
    if (accept("-")) return Expression::apply(Op::kNegate, {unary(depth + 1)});
    if (accept("+")) return unary(depth + 1);
    Expression base = primary(depth + 1);
    if (accept("**") || accept("^")) return Expression::apply(Op::kPower, {base, unary(depth + 1)});
    return base;
  }

  Expression primary(int depth) {
    enter(depth);
    skip_space();
    if (at_ == text_.size()) fail("a number, a variable or '('");
    const char c = text_[at_];
    if (c == '(') {
      ++at_;
      Expression inner = sum(depth + 1);
      if (!accept(")")) fail("')'");
      return inner;
    }
    if ((c >= '0' && c <= '9') || c == '.') return literal();
    if (is_letter(c)) return named(depth);
    fail("a number, a variable or '('");
  }

  static bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
  }
  static bool is_word(char c) { return is_letter(c) || (c >= '0' && c <= '9'); }

  Expression literal() {
    double value = 0.0;
    const char* begin = text_.data() + at_;
    const auto [end, error] = std::from_chars(begin, text_.data() + text_.size(), value);
    if (error != std::errc{} || !std::isfinite(value)) fail("a finite number");
    at_ += static_cast<std::size_t>(end - begin);
    if (at_ < text_.size() && is_word(text_[at_])) fail("an operator after the number");
    return Expression::number(value);
  }

  Expression named(int depth) {
    const std::size_t begin = at_;
    while (at_ < text_.size() && is_word(text_[at_])) ++at_;
    const std::string_view word = text_.substr(begin, at_ - begin);
    if (!accept("(")) {
      if (word == "pi") return Expression::number(std::numbers::pi);
      return Expression::variable(std::string(word));
    }
    const Function* function = nullptr;
    for (const Function& f : kFunctions) {
      if (f.name == word) function = &f;
    }
    if (function == nullptr) {
      at_ = begin;
      fail(
          "a function of the grammar (sin, cos, tan, asin, acos, atan, exp, log, sqrt, abs, sign, "
          "tanh, atan2, min, max, hat)");
    }
    std::vector<Expression> arguments;
    do {
      arguments.push_back(sum(depth + 1));
    } while (accept(","));
    if (!accept(")")) fail("',' or ')'");
    if (static_cast<int>(arguments.size()) != function->arity) {
      at_ = begin;
      fail(std::to_string(function->arity) + " argument(s) for " + std::string(word) + ", found " +
           std::to_string(arguments.size()));
    }
    return Expression::apply(function->op, std::move(arguments));
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

std::string format_number(double value) {
  std::array<char, 32> buffer{};
  const auto [end, error] = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return error == std::errc{} ? std::string(buffer.data(), end) : "0";
}

int precedence(const Expression& e) {
  switch (e.op()) {
    case Op::kAdd:
    case Op::kSubtract:
      return 1;
    case Op::kMultiply:
    case Op::kDivide:
      return 2;
    case Op::kNegate:
      return 3;
    case Op::kPower:
      return 4;
    case Op::kNumber:
      return e.value() < 0.0 ? 3 : 5;
    default:
      return 5;
  }
}

std::string wrap(const Expression& e, int minimum) {
  return precedence(e) < minimum ? "(" + e.to_string() + ")" : e.to_string();
}

}  // namespace

Expression Expression::parse(std::string_view text) { return Parser(text).parse(); }

std::set<std::string> Expression::variables() const {
  std::set<std::string> result;
  if (op() == Op::kVariable) result.insert(name());
  for (const Expression& a : arguments()) result.merge(a.variables());
  return result;
}

std::string Expression::to_string() const {
  const auto& a = arguments();
  switch (op()) {
    case Op::kNumber:
      return format_number(value());
    case Op::kVariable:
      return name();
    case Op::kAdd:
      return wrap(a[0], 1) + " + " + wrap(a[1], 2);
    case Op::kSubtract:
      return wrap(a[0], 1) + " - " + wrap(a[1], 2);
    case Op::kMultiply:
      return wrap(a[0], 2) + "*" + wrap(a[1], 3);
    case Op::kDivide:
      return wrap(a[0], 2) + "/" + wrap(a[1], 3);
    case Op::kNegate:
      return "-" + wrap(a[0], 3);
    case Op::kPower:
      return wrap(a[0], 5) + "^" + wrap(a[1], 3);
    default:
      break;
  }
  std::string text(function_name(op()));
  text += "(";
  for (std::size_t i = 0; i < a.size(); ++i) text += (i ? ", " : "") + a[i].to_string();
  return text + ")";
}

std::string Expression::to_json() const {
  if (op() == Op::kNumber) return R"({"op":"number","value":)" + format_number(value()) + "}";
  if (op() == Op::kVariable) return R"({"op":"variable","name":")" + name() + "\"}";
  std::string tag(function_name(op()));
  if (op() == Op::kAdd) tag = "add";
  if (op() == Op::kSubtract) tag = "subtract";
  if (op() == Op::kMultiply) tag = "multiply";
  if (op() == Op::kDivide) tag = "divide";
  if (op() == Op::kNegate) tag = "negate";
  std::string text = R"({"op":")" + tag + R"(","args":[)";
  for (std::size_t i = 0; i < arguments().size(); ++i)
    text += (i ? "," : "") + arguments()[i].to_json();
  return text + "]}";
}

// --- evaluation
// ------------------------------------------------------------------------------------------------------

double Expression::evaluate(const Lookup& lookup) const {
  if (op() == Op::kNumber) return value();
  if (op() == Op::kVariable) return lookup(name());
  std::array<double, 4> values{};
  for (std::size_t i = 0; i < arguments().size(); ++i) values[i] = arguments()[i].evaluate(lookup);
  return evaluate_op(op(), values.data());
}

namespace {

// Values of all rows at once; with slopes by `by` where T carries one.
template <typename T>
std::vector<T> evaluate_rows(const Expression& e, std::size_t rows,
                             const Expression::Columns& columns, const std::string& by) {
  if (e.is_constant()) return std::vector<T>(rows, T(e.value()));
  std::vector<T> result;
  if (e.op() == Op::kVariable) {
    const std::vector<double>& column = columns(e.name());
    result.reserve(rows);
    for (std::size_t row = 0; row < rows; ++row)
      result.emplace_back(column.size() == rows ? column[row] : column.at(0));
    if constexpr (std::is_same_v<T, Slope>) {
      if (e.name() == by) {
        for (Slope& value : result) value.v[0] = 1.0;
      }
    }
    return result;
  }
  // Constant arguments (the nodes of a hat, an order, an exponent) are not spread over rows.
  std::array<std::vector<T>, 4> values;
  std::array<T, 4> scratch{};
  const std::size_t count = e.arguments().size();
  for (std::size_t i = 0; i < count; ++i) {
    if (e.arguments()[i].is_constant()) {
      scratch[i] = T(e.arguments()[i].value());
    } else {
      values[i] = evaluate_rows<T>(e.arguments()[i], rows, columns, by);
    }
  }
  result.reserve(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < count; ++i) {
      if (!values[i].empty()) scratch[i] = values[i][row];
    }
    result.push_back(evaluate_op(e.op(), scratch.data()));
  }
  return result;
}

}  // namespace

std::vector<double> Expression::evaluate(std::size_t rows, const Columns& columns) const {
  return evaluate_rows<double>(*this, rows, columns, {});
}

std::vector<double> Expression::slopes(std::size_t rows, const Columns& columns,
                                       const std::string& variable) const {
  std::vector<double> result;
  result.reserve(rows);
  for (const Slope& value : evaluate_rows<Slope>(*this, rows, columns, variable))
    result.push_back(value.v[0]);
  return result;
}

Expression Expression::substitute(const std::map<std::string, double>& values) const {
  std::map<std::string, Expression> numbers;
  for (const auto& [name, value] : values) numbers.emplace(name, number(value));
  return substitute(numbers);
}

Expression Expression::substitute(const std::map<std::string, Expression>& values) const {
  if (op() == Op::kVariable) {
    const auto found = values.find(name());
    return found == values.end() ? *this : found->second;
  }
  if (op() == Op::kNumber) return *this;
  std::vector<Expression> replaced;
  for (const Expression& a : arguments()) replaced.push_back(a.substitute(values));
  return apply(op(), std::move(replaced));
}

}  // namespace armtrue
