// Helpers shared by the tests.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/lie.hpp"

namespace idol::test {

/// Numeric Jacobian of f at zero by central differences.
inline Eigen::MatrixXd numeric_jacobian(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f,
                                        Eigen::Index inputs, double step = 1e-6) {
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(inputs);
  Eigen::MatrixXd J(f(zero).size(), inputs);
  for (Eigen::Index i = 0; i < inputs; ++i) {
    Eigen::VectorXd d = zero;
    d[i] = step;
    J.col(i) = (f(d) - f(-d)) / (2 * step);
  }
  return J;
}

/// Fails, printing both, unless the analytic Jacobian agrees with the numeric one.
inline void expect_jacobian(const Eigen::MatrixXd& analytic, const Eigen::MatrixXd& numeric, double tolerance) {
  ASSERT_EQ(analytic.rows(), numeric.rows());
  ASSERT_EQ(analytic.cols(), numeric.cols());
  EXPECT_LT((analytic - numeric).cwiseAbs().maxCoeff(), tolerance)
      << "analytic:\n" << analytic << "\nnumeric:\n" << numeric;
}

/// A vector with independent normal entries.
inline Vec3 random_vec3(std::mt19937& rng, double sigma = 1.0) {
  std::normal_distribution<double> normal(0.0, sigma);
  return {normal(rng), normal(rng), normal(rng)};
}

/// Each part is somewhere in the text.
inline void expect_says(const std::string& text, const std::vector<std::string>& parts) {
  for (const auto& part : parts) EXPECT_NE(text.find(part), std::string::npos) << part << "\nnot in: " << text;
}

/// What the DataError that the action throws says; empty if it throws none.
inline std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const DataError& e) {
    return e.what();
  }
  return "";
}

/// A folder that is removed with its contents at the end of the test.
class TempDir {
 public:
  TempDir() {
    std::string name = (std::filesystem::temp_directory_path() / "idol_test_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp failed");
    path_ = name;
  }
  ~TempDir() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(path_ / name, std::ios::binary) << text;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

/// Result of running a command line: exit status, standard output and standard error.
struct CommandResult {
  int status = -1;
  std::string out;
  std::string err;
};

/// Runs the built `idol` program with the given arguments through the shell.
inline CommandResult run_idol(const std::string& arguments) {
  TempDir dir;
  const std::string out = (dir.path() / "out").string();
  const std::string err = (dir.path() / "err").string();
  const std::string command = std::string(IDOL_PROGRAM) + " " + arguments + " >" + out + " 2>" + err;
  const int status = std::system(command.c_str());
  const auto slurp = [](const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), slurp(out), slurp(err)};
}

}  // namespace idol::test
