"""Sentences: the only package that makes words of findings, for a person at the command line or in
Python.  One file a subject.

Read `sentences` first.  It lies this low because records show their findings when they are printed.
"""

from estim.words.agreement import common_error
from estim.words.first_steps import first_step
from estim.words.parameters import one_sided
from estim.words.releases import told_apart
from estim.words.residuals import TESTS, name_of_test
from estim.words.rolling import sure
from estim.words.statuses import status_words
from estim.words.sentences import Choice, advice, advice_for, choices_for, describe
from estim.words.trials import direction_words
