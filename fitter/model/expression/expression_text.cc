#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "fitter/model/expression/expression.h"

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

struct Operator {
  std::string_view name, symbol;
  Op op;
  int precedence, left, right;  // its own, and the least of its arguments that need no brackets
};

constexpr std::array<Operator, 6> kOperators{{{"add", " + ", Op::kAdd, 1, 1, 2},
                                              {"subtract", " - ", Op::kSubtract, 1, 1, 2},
                                              {"multiply", "*", Op::kMultiply, 2, 2, 3},
                                              {"divide", "/", Op::kDivide, 2, 2, 3},
                                              {"negate", "-", Op::kNegate, 3, 3, 3},
                                              {"pow", "^", Op::kPower, 4, 5, 3}}};

// The entry of an operation; nullptr where it is not in the table.
template <typename Table>
auto entry_of(const Table& table, Op op) {
  const auto at = std::ranges::find(table, op, &Table::value_type::op);
  return at == table.end() ? nullptr : &*at;
}

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

  // A chain of operators builds a tree as deep as the chain is long, so its length is limited too.
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
    const auto function = std::ranges::find(kFunctions, word, &Function::name);
    if (function == kFunctions.end()) {
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
  if (const Operator* o = entry_of(kOperators, e.op())) return o->precedence;
  return e.op() == Op::kNumber && e.value() < 0.0 ? 3 : 5;
}

std::string wrap(const Expression& e, int minimum) {
  return precedence(e) < minimum ? "(" + e.to_string() + ")" : e.to_string();
}

}  // namespace

Expression Expression::parse(std::string_view text) { return Parser(text).parse(); }

std::string Expression::to_string() const {
  const auto& a = arguments();
  if (op() == Op::kNumber) return format_number(value());
  if (op() == Op::kVariable) return name();
  if (const Operator* o = entry_of(kOperators, op())) {
    return (a.size() > 1 ? wrap(a[0], o->left) : "") + std::string(o->symbol) +
           wrap(a.back(), o->right);
  }
  std::string text = std::string(entry_of(kFunctions, op())->name) + "(";
  for (std::size_t i = 0; i < a.size(); ++i) text += (i ? ", " : "") + a[i].to_string();
  return text + ")";
}

std::string Expression::to_json() const {
  if (op() == Op::kNumber) return R"({"op":"number","value":)" + format_number(value()) + "}";
  if (op() == Op::kVariable) return R"({"op":"variable","name":")" + name() + "\"}";
  const Operator* const o = entry_of(kOperators, op());
  std::string text =
      R"({"op":")" + std::string(o ? o->name : entry_of(kFunctions, op())->name) + R"(","args":[)";
  for (std::size_t i = 0; i < arguments().size(); ++i)
    text += (i ? "," : "") + arguments()[i].to_json();
  return text + "]}";
}

}  // namespace armtrue
