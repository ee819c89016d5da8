#include "fitter/model/expression/expression.h"

#include <ceres/jet.h>

#include <array>
#include <cmath>
#include <type_traits>

namespace armtrue {
namespace {

using Op = Expression::Op;

// A number with its derivative: the templates below serve it and plain numbers.
using Slope = ceres::Jet<double, 1>;
double number_of(double v) { return v; }
double number_of(const Slope& v) { return v.a; }

// hat(v, l, c, r). A missing side (l = c or r = c) is constant, so that tables extrapolate flat.
template <typename T>
T hat(const T& v, const T& l, const T& c, const T& r) {
  if (v <= c) {
    if (l >= c) return T(1.0);
    return v <= l ? T(0.0) : (v - l) / (c - l);
  }
  if (r <= c) return T(1.0);
  return v >= r ? T(0.0) : (r - v) / (r - c);
}

// NaN stays NaN, here and in min and max, so that it is detected and refused.
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
    // A result that is not finite is not folded, so that the error appears where the expression is
    // evaluated.
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

std::set<std::string> Expression::variables() const {
  std::set<std::string> result;
  if (op() == Op::kVariable) result.insert(name());
  for (const Expression& a : arguments()) result.merge(a.variables());
  return result;
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
  // Constant arguments (the nodes of a hat, an order, an exponent) are not expanded to rows.
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
