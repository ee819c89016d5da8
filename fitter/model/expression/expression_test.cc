#include "fitter/model/expression/expression.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "fitter/testing/reference_kinematics.h"

namespace armtrue {
namespace {

const std::map<std::string, double> kState{{"q1", 0.3}, {"q2", -1.1},     {"tau2", 412.0},
                                           {"dT", 7.5}, {"time", 1800.0}, {"w", 0.7}};

std::map<std::string, std::vector<double>> columns_of(const std::map<std::string, double>& state) {
  std::map<std::string, std::vector<double>> columns;
  for (const auto& [name, number] : state) columns[name] = {number};
  return columns;
}

double value(const Expression& e, const std::map<std::string, double>& state = kState) {
  const auto columns = columns_of(state);
  return e
      .evaluate(
          1,
          [&](const std::string& name) -> const std::vector<double>& { return columns.at(name); })
      .front();
}
double value(const std::string& text) { return value(Expression::parse(text)); }

std::string error_of(const std::string& text) {
  try {
    Expression::parse(text);
  } catch (const ExpressionError& error) {
    return error.what();
  }
  return "";
}

TEST(Expression, FollowsThePrecedenceOfArithmetic) {
  EXPECT_DOUBLE_EQ(value("1 + 2*3"), 7.0);
  EXPECT_DOUBLE_EQ(value("2*3^2"), 18.0);
  EXPECT_DOUBLE_EQ(value("-2^2"), -4.0);
  EXPECT_DOUBLE_EQ(value("2^-1"), 0.5);
  EXPECT_DOUBLE_EQ(value("2^3^2"), 512.0);
  EXPECT_DOUBLE_EQ(value("2**3**2"), 512.0);
  EXPECT_DOUBLE_EQ(value("10 - 4 - 3"), 3.0);
  EXPECT_DOUBLE_EQ(value("24/4/3"), 2.0);
  EXPECT_DOUBLE_EQ(value("(1 + 2)*-3"), -9.0);
  EXPECT_DOUBLE_EQ(value("--2"), 2.0);
  EXPECT_DOUBLE_EQ(value("+2 - +1"), 1.0);
  EXPECT_DOUBLE_EQ(value("1e-3*1.5E2"), 0.15);
  EXPECT_DOUBLE_EQ(value("pi"), std::numbers::pi);
}

TEST(Expression, EvaluatesTheFunctionsOfTheGrammar) {
  EXPECT_DOUBLE_EQ(value("sin(q1)"), std::sin(0.3));
  EXPECT_DOUBLE_EQ(value("atan2(q1, q2)"), std::atan2(0.3, -1.1));
  EXPECT_DOUBLE_EQ(value("min(q1, q2) + max(q1, q2)"), 0.3 - 1.1);
  EXPECT_DOUBLE_EQ(value("tau2*abs(tau2)"), 412.0 * 412.0);
  EXPECT_DOUBLE_EQ(value("sign(q2) + sign(0) + sign(q1)"), 0.0);
  EXPECT_DOUBLE_EQ(value("tanh(q1) - exp(q1)/sqrt(dT) + log(dT)"),
                   std::tanh(0.3) - std::exp(0.3) / std::sqrt(7.5) + std::log(7.5));
}

TEST(Expression, HatIsOneAtItsCentreAndFlatBeyondTheEnds) {
  EXPECT_DOUBLE_EQ(value("hat(0.5, 0, 1, 2)"), 0.5);
  EXPECT_DOUBLE_EQ(value("hat(1, 0, 1, 2)"), 1.0);
  EXPECT_DOUBLE_EQ(value("hat(1.75, 0, 1, 2)"), 0.25);
  EXPECT_DOUBLE_EQ(value("hat(2, 0, 1, 2) + hat(0, 0, 1, 2) + hat(-9, 0, 1, 2)"), 0.0);
  EXPECT_DOUBLE_EQ(value("hat(-9, 1, 1, 2)"), 1.0);
  EXPECT_DOUBLE_EQ(value("hat(9, 0, 1, 1)"), 1.0);
  // Neighbouring hats add up to one: a table of equal nodes is a constant.
  for (double v = -0.5; v < 2.5; v += 0.01) {
    const std::string at = std::to_string(v);
    EXPECT_NEAR(value("hat(" + at + ",0,0,1) + hat(" + at + ",0,1,2) + hat(" + at + ",1,2,2)"), 1.0,
                1e-12)
        << v;
  }
}

TEST(Expression, EvaluationOfAllRowsAndOfOneAgree) {
  const std::vector<double> q1{-1.0, 0.0, 0.5, 2.0}, w{3.0};
  const auto columns = [&](const std::string& name) -> const std::vector<double>& {
    return name == "q1" ? q1 : w;
  };
  for (const char* text :
       {"sin(w*q1)", "hat(q1, -1, 0, 1)*w", "w", "3", "q1", "atan2(q1, w) + min(q1, 0.2)"}) {
    const Expression e = Expression::parse(text);
    const std::vector<double> all = e.evaluate(q1.size(), columns);
    ASSERT_EQ(all.size(), q1.size());
    for (std::size_t i = 0; i < q1.size(); ++i) {
      EXPECT_EQ(all[i], value(e, {{"q1", q1[i]}, {"w", w[0]}})) << text;
    }
  }
}

double slope(const Expression& e, const std::string& by,
             const std::map<std::string, double>& state) {
  const auto columns = columns_of(state);
  return e
      .slopes(
          1,
          [&](const std::string& name) -> const std::vector<double>& { return columns.at(name); },
          by)
      .front();
}

// Random trees of the whole grammar: every text that is written must parse to the same values.
class RandomTrees : public ::testing::Test {
 protected:
  Expression tree(int depth, bool smooth) {
    using Op = Expression::Op;
    const auto pick = [&](std::size_t count) {
      return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_);
    };
    if (depth == 0 || pick(5) == 0) {
      if (pick(2) == 0)
        return Expression::number(std::normal_distribution<double>(0.0, 2.0)(random_));
      static const char* const names[] = {"q1", "q2", "w", "dT"};
      return Expression::variable(names[pick(4)]);
    }
    static const Op smooth_ops[] = {
        Op::kAdd, Op::kSubtract, Op::kMultiply, Op::kDivide, Op::kPower, Op::kNegate,
        Op::kSin, Op::kCos,      Op::kTan,      Op::kAsin,   Op::kAcos,  Op::kAtan,
        Op::kExp, Op::kLog,      Op::kSqrt,     Op::kTanh,   Op::kAtan2};
    static const Op kinked_ops[] = {Op::kAbs, Op::kSign, Op::kMin, Op::kMax, Op::kHat};
    const std::size_t chosen = pick(std::size(smooth_ops) + (smooth ? 0 : std::size(kinked_ops)));
    const Op op = chosen < std::size(smooth_ops) ? smooth_ops[chosen]
                                                 : kinked_ops[chosen - std::size(smooth_ops)];
    const auto sub = [&] { return tree(depth - 1, smooth); };
    if (op == Op::kHat) {
      return Expression::apply(
          op, {sub(), Expression::number(-1.0), Expression::number(0.2), Expression::number(1.5)});
    }
    const bool two = op == Op::kAdd || op == Op::kSubtract || op == Op::kMultiply ||
                     op == Op::kDivide || op == Op::kPower || op == Op::kAtan2 || op == Op::kMin ||
                     op == Op::kMax;
    if (two) return Expression::apply(op, {sub(), sub()});
    return Expression::apply(op, {sub()});
  }

  std::mt19937_64 random_{20260303};
};

TEST_F(RandomTrees, TextParsesBackToTheSameTree) {
  for (int i = 0; i < 3000; ++i) {
    const Expression e = tree(6, false);
    const std::string text = e.to_string();
    const Expression again = Expression::parse(text);
    EXPECT_EQ(again.to_string(), text);
    const double a = value(e), b = value(again);
    EXPECT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << text << ": " << a << " and " << b;
  }
}

TEST_F(RandomTrees, SlopesMatchAutomaticDifferentiation) {
  using Jet = ceres::Jet<double, 1>;
  int compared = 0;
  for (int i = 0; i < 4000; ++i) {
    const Expression e = tree(4, false);
    const Jet reference = testing::reference_value<Jet>(e, [](const std::string& name) {
      Jet jet(kState.at(name));
      if (name == "q1") jet.v[0] = 1.0;
      return jet;
    });
    const double derivative = slope(e, "q1", kState);
    // Where the grammar's value or Jet's derivative is not finite (a pole, a root of a negative),
    // there is nothing to compare.
    if (!std::isfinite(value(e)) || !std::isfinite(reference.a) || !std::isfinite(reference.v[0]) ||
        !std::isfinite(derivative))
      continue;
    EXPECT_NEAR(derivative, reference.v[0], 1e-9 * std::max(1.0, std::abs(reference.v[0])))
        << e.to_string();
    ++compared;
  }
  EXPECT_GT(compared, 2000);
}

TEST_F(RandomTrees, SubstitutionGivesTheSameValueAsEvaluation) {
  for (int i = 0; i < 1000; ++i) {
    const Expression e = tree(5, false);
    const Expression closed = e.substitute(kState);
    EXPECT_TRUE(closed.variables().empty());
    const double a = value(e), b = value(closed);
    // Zero times NaN folds to zero.
    if (std::isnan(a)) continue;
    EXPECT_TRUE(a == b || std::abs(a - b) < 1e-9 * std::abs(a)) << e.to_string();
  }
}

TEST(Expression, HatSlopesAreCorrectForEachArgument) {
  const Expression hat = Expression::parse("hat(q, l, c, r)");
  const auto at = [&](double q, const char* by) {
    return slope(hat, by, {{"q", q}, {"l", 0.0}, {"c", 1.0}, {"r", 3.0}});
  };
  EXPECT_DOUBLE_EQ(at(0.5, "q"), 1.0);
  EXPECT_DOUBLE_EQ(at(2.0, "q"), -0.5);
  EXPECT_DOUBLE_EQ(at(-1.0, "q"), 0.0);
  EXPECT_DOUBLE_EQ(at(4.0, "q"), 0.0);
  EXPECT_DOUBLE_EQ(at(0.5, "l"), -0.5);  // (q - l) / (c - l)
  EXPECT_DOUBLE_EQ(at(0.5, "c"), -0.5);
  EXPECT_DOUBLE_EQ(at(0.5, "r"), 0.0);
  EXPECT_DOUBLE_EQ(at(2.0, "c"), 0.25);  // (r - q) / (r - c)
  EXPECT_DOUBLE_EQ(at(2.0, "r"), 0.25);
}

TEST(Expression, NumbersRoundTripToTheLastBit) {
  std::mt19937_64 random(5);
  for (int i = 0; i < 2000; ++i) {
    double v = 0.0;
    const std::uint64_t bits = random();
    static_assert(sizeof v == sizeof bits);
    std::memcpy(&v, &bits, sizeof v);
    if (!std::isfinite(v)) continue;
    EXPECT_EQ(value(Expression::number(v).to_string()), v);
  }
}

TEST(Expression, SyntaxError_NamesPlaceFoundAndExpected) {
  EXPECT_EQ(error_of("sin(q1"), "at character 7: found the end, expected ',' or ')'");
  EXPECT_NE(error_of("q1 +").find("at character 5"), std::string::npos) << error_of("q1 +");
  EXPECT_NE(error_of("system(1)").find("function of the grammar"), std::string::npos);
  EXPECT_NE(error_of("atan2(q1)").find("2 argument(s)"), std::string::npos);
  EXPECT_NE(error_of("2q1").find("operator after the number"), std::string::npos);
}

TEST(Expression, RefusesEverythingThatIsNotArithmetic) {
  for (const char* hostile : {"",          " ",         "q1;q2",  "__import__('os')",
                              "q1.real",   "lambda: 1", "q1 = 2", "q1[0]",
                              "'a'",       "\"a\"",     "1e999",  "0x10",
                              "1..2",      "q1 q2",     "()",     "(",
                              ")",         "sin()",     "sin(,)", "hat(q1)",
                              "1/",        "*2",        "q1 ** ", "{}",
                              "@q1",       "q1 // 2",   "q1 % 2", "q1 if q2 else q1",
                              "\xff\xfe",  "é",         "1,2",    "sin(q1)) + (1",
                              "eval(q1)",  "1e",        "nan(1)", "--",
                              "q1 and q2", "!q1",       "~1"}) {
    EXPECT_THROW(Expression::parse(hostile), ExpressionError) << hostile;
  }
  EXPECT_THROW(Expression::parse(std::string_view("1\0+1", 4)), ExpressionError);
}

// Text of hostile depth or length must give an error message, and not a stack overflow.
TEST(Expression, RefusesHostileDepthAndLength) {
  EXPECT_THROW(Expression::parse(std::string(5000, '(')), ExpressionError);
  EXPECT_THROW(Expression::parse(std::string(5000, '-') + "1"), ExpressionError);
  std::string powers = "q1", sums = "q1", products = "q1";
  for (int i = 0; i < 3000; ++i) {
    powers += "^q1";
    sums += "+q1";
    products += "*q1";
  }
  for (const std::string& text : {powers, sums, products})
    EXPECT_THROW(Expression::parse(text), ExpressionError);
  EXPECT_THROW(Expression::parse(std::string(30000, ' ') + "1"), ExpressionError);
}

TEST(Expression, FiveHundredTerms_ParseAndRoundTrip) {
  std::string text = "q1";
  for (int i = 0; i < 500; ++i) text += " + q2*" + std::to_string(i);
  EXPECT_TRUE(std::isfinite(value(text)));
  EXPECT_EQ(Expression::parse(Expression::parse(text).to_string()).to_string(),
            Expression::parse(text).to_string());
}

// NaN must reach the check that refuses it, and not be hidden by a finite second argument.
TEST(Expression, MinMaxAndSignPropagateNan) {
  for (const char* text : {"min(q1, log(q2))", "max(log(q2), q1)", "sign(log(q2))"})
    EXPECT_TRUE(std::isnan(value(text))) << text;
}

TEST(Expression, FoldsConstantsExceptNonFiniteOnes) {
  EXPECT_TRUE(Expression::parse("2*3 + sin(0)").is_constant());
  EXPECT_FALSE(Expression::parse("1/0").is_constant());
  EXPECT_EQ(Expression::parse("0*q1").to_string(), "0");
  EXPECT_EQ(Expression::parse("1*q1 + 0").to_string(), "q1");
}

TEST(Expression, TextKeepsTheBracketsOfTheTree) {
  for (const char* text :
       {"q1 + q2*q3", "q1 - (q2 - q3)", "q1 + (q2 - q3)", "q1*(q2 + q3)", "q1/(q2*q3)",
        "(q1/q2)^q3^2", "-q1^2", "-(q1 + q2)", "(q1^2)^q3", "q1*q2 - q2/q3"}) {
    EXPECT_EQ(Expression::parse(text).to_string(), text);
  }
}

TEST(Expression, NamesItsVariables) {
  EXPECT_EQ(Expression::parse("sin(w*q1) + tau2^2").variables(),
            (std::set<std::string>{"q1", "tau2", "w"}));
}

TEST(Expression, JsonHasOperationsAndArguments) {
  EXPECT_EQ(
      Expression::parse("sin(q1)*2").to_json(),
      R"({"op":"multiply","args":[{"op":"sin","args":[{"op":"variable","name":"q1"}]},{"op":"number","value":2}]})");
}

}  // namespace
}  // namespace armtrue
