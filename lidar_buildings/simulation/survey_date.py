"""The day on which every virtual survey was flown: files must not depend on the day they were made."""

from datetime import date

#: A Monday in May.
SURVEY_DATE = date(2024, 5, 6)
