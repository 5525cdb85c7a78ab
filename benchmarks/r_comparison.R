# Reads data sets (set, kind, group, value), and prints what R finds: set, name, value. Run by r_comparison.py.
suppressPackageStartupMessages({library(coin); library(exactRankTests)})
data <- read.csv(file("stdin"), stringsAsFactors = FALSE)
options(digits = 17)
put <- function(set, name, value) cat(set, name, format(as.numeric(value), digits = 17), sep = ",", fill = TRUE)
quiet <- function(call) suppressWarnings(call)

interval <- function(set, tested, count) {  # of five pairs R prints the 93.75 % interval as one of 95 %
  put(set, "shift", tested$estimate)
  if (count < 6) return()
  put(set, "shift_low", tested$conf.int[1]); put(set, "shift_high", tested$conf.int[2])
}

paired <- function(set, first, second, plain) {
  moved <- second - first
  if (plain) { tested <- quiet(wilcox.test(moved, exact = TRUE, conf.int = TRUE)); put(set, "wilcox.test exact", tested$p.value); interval(set, tested, length(moved)) }
  put(set, "wilcox.test corrected", quiet(wilcox.test(moved, exact = FALSE)$p.value))
  put(set, "wilcox.test uncorrected", quiet(wilcox.test(moved, exact = FALSE, correct = FALSE)$p.value))
  put(set, "wilcox.exact", quiet(wilcox.exact(moved)$p.value))
  for (zeros in c("Wilcoxon", "Pratt"))
    put(set, paste("wilcoxsign_test", zeros), pvalue(wilcoxsign_test(second ~ first, distribution = "exact", zero.method = zeros)))
  low <- quiet(wilcox.exact(moved, mu = -1, alternative = "greater")$p.value)
  put(set, "TOST rank", max(low, quiet(wilcox.exact(moved, mu = 2, alternative = "less")$p.value)))
  if (sd(moved) > 0)
    put(set, "TOST t", max(t.test(moved, mu = -1, alternative = "greater")$p.value, t.test(moved, mu = 2, alternative = "less")$p.value))
}

unpaired <- function(set, first, second, plain) {
  if (plain) { tested <- wilcox.test(second, first, exact = TRUE, conf.int = TRUE); put(set, "wilcox.test exact", tested$p.value); interval(set, tested, length(c(first, second))) }
  put(set, "wilcox.test corrected", quiet(wilcox.test(second, first, exact = FALSE)$p.value))
  put(set, "wilcox.test uncorrected", quiet(wilcox.test(second, first, exact = FALSE, correct = FALSE)$p.value))
  put(set, "wilcox.exact", quiet(wilcox.exact(second, first)$p.value))
  values <- data.frame(value = c(first, second), group = factor(rep(1:2, c(length(first), length(second)))))
  put(set, "wilcox_test", pvalue(wilcox_test(value ~ group, values, distribution = "exact")))
  low <- quiet(wilcox.exact(second, first, mu = -1, alternative = "greater")$p.value)
  put(set, "TOST rank", max(low, quiet(wilcox.exact(second, first, mu = 2, alternative = "less")$p.value)))
  if (sd(first) + sd(second) > 0)
    put(set, "TOST t", max(t.test(second, first, mu = -1, alternative = "greater")$p.value, t.test(second, first, mu = 2, alternative = "less")$p.value))
}

hits <- function(set, first, second) {
  discordant <- sum(first != second)
  if (discordant > 0) put(set, "binom.test", binom.test(sum(second > first), discordant)$p.value)
  counts <- rbind(c(sum(second), sum(1 - second)), c(sum(first), sum(1 - first)))
  if (all(colSums(counts) > 0)) {
    tested <- fisher.test(counts)
    put(set, "fisher.test", tested$p.value); put(set, "odds", tested$estimate)
    put(set, "odds_low", tested$conf.int[1]); put(set, "odds_high", tested$conf.int[2])
  }
}

for (set in unique(data$set)) {
  here <- data[data$set == set, ]
  kind <- here$kind[1]
  samples <- split(here$value, here$group)
  plain <- grepl("plain", kind)
  if (grepl("^paired", kind)) paired(set, samples[[1]], samples[[2]], plain)
  else if (grepl("^unpaired", kind)) unpaired(set, samples[[1]], samples[[2]], plain)
  else if (kind == "hits") hits(set, samples[[1]], samples[[2]])
  else {
    put(set, "kruskal.test", kruskal.test(here$value, factor(here$group))$p.value)
    put(set, "friedman.test", friedman.test(do.call(cbind, samples))$p.value)
  }
}
