// Expressions of the state: the one form in which every basis function exists, from model.yaml's
// `custom` to the firmware's term list. Grammar: docs/model.md, section "Terms".
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace armtrue {

/// Raised for text that is not an expression; what() says what was found, where, and what was
/// expected.
class ExpressionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Immutable expression tree over named variables (state or nonlinear parameters).
class Expression {
 public:
  enum class Op {
    kNumber,
    kVariable,
    kAdd,
    kSubtract,
    kMultiply,
    kDivide,
    kPower,
    kNegate,
    kSin,
    kCos,
    kTan,
    kAsin,
    kAcos,
    kAtan,
    kExp,
    kLog,
    kSqrt,
    kAbs,
    kSign,
    kTanh,
    kAtan2,
    kMin,
    kMax,
    kHat
  };

  /// Parses `text`. Throws ExpressionError; never evaluates anything but arithmetic.
  static Expression parse(std::string_view text);
  static Expression number(double value);
  static Expression variable(std::string name);
  static Expression apply(Op op, std::vector<Expression> arguments);

  Op op() const;
  double value() const;             ///< of a kNumber
  const std::string& name() const;  ///< of a kVariable
  const std::vector<Expression>& arguments() const;

  /// Names of all variables that occur.
  std::set<std::string> variables() const;
  bool is_constant() const { return op() == Op::kNumber; }

  /// Text that parses back to an equal tree; numbers round-trip exactly.
  std::string to_string() const;
  /// The tree as nested JSON: {"op": "sin", "args": [...]}, {"op": "number", "value": 1}, {"op":
  /// "variable", "name": "q1"}.
  std::string to_json() const;

  using Columns = std::function<const std::vector<double>&(const std::string&)>;
  /// Values for `rows` states at once; `columns` gives each variable's column (size `rows`, or 1
  /// for a scalar).
  std::vector<double> evaluate(std::size_t rows, const Columns& columns) const;

  /// Derivatives with respect to `variable` for `rows` states at once (automatic differentiation);
  /// at kinks (abs, hat, min, max) that of one of the sides.
  std::vector<double> slopes(std::size_t rows, const Columns& columns,
                             const std::string& variable) const;
  /// Replaces variables by numbers, or by other expressions.
  Expression substitute(const std::map<std::string, double>& values) const;
  Expression substitute(const std::map<std::string, Expression>& values) const;

 private:
  struct Node;
  explicit Expression(std::shared_ptr<const Node> node) : node_(std::move(node)) {}
  std::shared_ptr<const Node> node_;
};

Expression operator+(const Expression& a, const Expression& b);
Expression operator-(const Expression& a, const Expression& b);
Expression operator*(const Expression& a, const Expression& b);
Expression operator/(const Expression& a, const Expression& b);

}  // namespace armtrue
